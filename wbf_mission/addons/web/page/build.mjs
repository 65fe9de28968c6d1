// Builds what users load from the sources: `npm ci && npm run check && npm run build`.
// The result is kept with the program, so that nobody needs node to use it.
import { createHash } from "node:crypto";
import { mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const out = new URL("../static/", import.meta.url).pathname;
const here = new URL("./", import.meta.url).pathname;
mkdirSync(out, { recursive: true });

const shared = {
  bundle: true,
  minify: true,
  target: "es2022",
  legalComments: "none", // the licences are in LICENSES.txt
  loader: { ".png": "dataurl" },
  absWorkingDir: here,
};
const pages = readdirSync(`${here}src`).filter((name) => name.endsWith(".page.ts"));
await build({
  ...shared,
  format: "iife",
  entryPoints: pages.map((name) => ({ in: `src/${name}`, out: name.replace(/\.page\.ts$/, "") })),
  outdir: out,
});
await build({ ...shared, entryPoints: [{ in: "src/page.css", out: "page" }], outdir: out });

const parts = ["leaflet", "uplot"].map((name) => {
  const version = JSON.parse(readFileSync(`${here}node_modules/${name}/package.json`, "utf8")).version;
  return `${name} ${version}\n\n${readFileSync(`${here}node_modules/${name}/LICENSE`, "utf8").trim()}\n`;
});
writeFileSync(`${out}LICENSES.txt`, parts.join("\n" + "-".repeat(78) + "\n\n"));

// By this a test sees, without node, that the built files are those of the sources.
const digest = createHash("sha256");
for (const name of readdirSync(`${here}src`).sort()) digest.update(name).update(readFileSync(`${here}src/${name}`));
digest.update(readFileSync(`${here}package-lock.json`));
writeFileSync(`${out}sources.sha256`, digest.digest("hex") + "\n");
