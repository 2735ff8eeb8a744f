// Bundles the page of replays into one file: node build.mjs TARGET. The page has no code or style but its own, by their hashes.

import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, renameSync, writeFileSync } from "node:fs";
import { dirname } from "node:path";
import { build } from "esbuild";

const target = process.argv[2];
const bundle = async (entry) => {
  const { outputFiles } = await build({ entryPoints: [entry], bundle: true, minify: true, write: false, format: "iife", target: "es2022", legalComments: "inline" });
  return outputFiles[0].text.trim();
};
const script = (await bundle("src/main.ts")).replaceAll("</script", "<\\/script");
const style = (await bundle("src/page.css")) + readFileSync("node_modules/uplot/dist/uPlot.min.css", "utf8").trim();
const hash = (text) => createHash("sha256").update(text, "utf8").digest("base64");
const parts = { SCRIPT_HASH: hash(script), STYLE_HASH: hash(style), STYLE: style, SCRIPT: script };
const page = readFileSync("src/page.html", "utf8").replace(/SCRIPT_HASH|STYLE_HASH|STYLE|SCRIPT/g, (name) => parts[name]);
mkdirSync(dirname(target), { recursive: true });
writeFileSync(`${target}.new`, page);
renameSync(`${target}.new`, target); // whole or not at all
