// The examples of node-mavlink that need a vehicle, written after them: the same calls in the same order.
// Run with NAME [PORT [ANSWERS_TO]].
const mavlink = require("node-mavlink");
const { common, minimal, ardupilotmega, MavLinkPacketSignature, sleep } = mavlink;

const registry = { ...minimal.REGISTRY, ...common.REGISTRY, ...ardupilotmega.REGISTRY };
const port = Number(process.argv[3] || 0);
const answersTo = Number(process.argv[4] || 14555);

async function tcp() {
  const link = new mavlink.MavTCP();
  await (port ? link.start("127.0.0.1", port) : link.start());
  return link;
}

async function udp() {
  const link = new mavlink.MavEsp8266();
  await (port ? link.start(port, answersTo) : link.start());
  return link;
}

function listen(link, kind, seen) {
  link.on("data", (packet) => {
    const type = registry[packet.header.msgid];
    if (type && packet.header.msgid === kind.MSG_ID) seen(packet.protocol.data(packet.payload, type), packet);
  });
}

function end() {
  console.log("done");
  process.exit(0);
}

async function version(link) {
  const command = new common.RequestProtocolVersionCommand();
  command.targetSystem = 1;
  command.targetComponent = 1;
  command.confirmation = 1;
  listen(link, common.CommandAck, (data) => {
    console.log("acknowledged", data.command);
    end();
  });
  await link.send(command);
}

function poll(link, name) {
  setInterval(() => {
    const message = new common.ParamRequestRead();
    Object.assign(message, { paramIndex: -1, paramId: name, targetSystem: 1, targetComponent: 1 });
    link.send(message);
  }, 200);
}

const examples = {
  "send-receive-tcp": async () => version(await tcp()),
  "send-receive-udp": async () => version(await udp()),
  "pool-param-udp": async () => {
    const link = await udp();
    const seen = new Set();
    listen(link, common.ParamValue, (data) => {
      if (!seen.has(data.paramId)) console.log(data.paramId, data.paramValue);
      seen.add(data.paramId);
      if (seen.has("MC_ROLLRATE_P") && seen.has("MC_PITCHRATE_P")) end();
    });
    await sleep(1000);
    poll(link, "MC_ROLLRATE_P"); // the example's ATC_RAT_RLL_P and ATC_RAT_PIT_P are ArduPilot's
    await sleep(100);
    poll(link, "MC_PITCHRATE_P");
  },
  "send-receive-signed-udp": async () => {
    const key = MavLinkPacketSignature.key("qwerty");
    const link = await udp();
    let count = 0;
    listen(link, common.ParamValue, (data, packet) => {
      count += 1;
      if (count < 100) return;
      console.log(packet.signature ? packet.signature.matches(key) : "not signed");
      end();
    });
    const message = new common.ParamRequestList();
    message.targetSystem = 1;
    message.targetComponent = 1;
    await link.sendSigned(message, key);
  },
  "send-receive-param-list-sitl": async () => {
    const link = await tcp(); // MavSitl, which the example uses, is not in the package
    let count = 0;
    listen(link, common.ParamValue, () => {
      count += 1;
      if (count === 100) end();
    });
    const message = new common.ParamRequestList();
    message.targetSystem = 1;
    message.targetComponent = 1;
    await link.send(message);
  },
};

setTimeout(() => {
  console.log("no end");
  process.exit(1);
}, 150000);
examples[process.argv[2]]();
