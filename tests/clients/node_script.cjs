// A script as people write them with node-mavlink; the port is its argument.
const net = require("net");
const mavlink = require("node-mavlink");

const { MavLinkPacketSplitter, MavLinkPacketParser, MavLinkProtocolV2, send } = mavlink;
const registry = { ...mavlink.minimal.REGISTRY, ...mavlink.common.REGISTRY, ...mavlink.ardupilotmega.REGISTRY };
const wanted = new Set(["Heartbeat", "NavControllerOutput", "RawImu", "ServoOutputRaw", "Ahrs2", "CommandAck"]);
const port = net.connect(Number(process.argv[2]), "127.0.0.1");
const protocol = new MavLinkProtocolV2(255, 190);

port.pipe(new MavLinkPacketSplitter()).pipe(new MavLinkPacketParser()).on("data", (packet) => {
  const type = registry[packet.header.msgid];
  if (!type || !wanted.delete(type.name)) return;
  const data = packet.protocol.data(packet.payload, type);
  if (type.name === "RawImu") console.log("RawImu", data.zacc);
  else if (type.name === "CommandAck") console.log("CommandAck", data.command, data.result);
  else console.log(type.name);
  if (wanted.size === 0) process.exit(0);
});
port.on("connect", async () => {
  const streams = Object.assign(new mavlink.common.RequestDataStream(), {
    targetSystem: 1, targetComponent: 1, reqStreamId: 0, reqMessageRate: 4, startStop: 1,
  });
  await send(port, streams, protocol);
  const mode = Object.assign(new mavlink.common.CommandLong(), {
    targetSystem: 1, targetComponent: 1, command: 176, _param1: 1, _param2: 4,
  });
  await send(port, mode, protocol);
});
setTimeout(() => process.exit(1), 20000);
