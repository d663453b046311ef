// Tests the pages of `umo view` and of bindings/web in a real browser. UMO, CHROMIUM and OUT name the program, the
// browser and a folder.

import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";

import { Chromium } from "./chromium.mjs";
import { cut } from "./frames.mjs";
import * as file from "./file.mjs";
import * as judge from "./judge.mjs";
import * as live from "./live.mjs";
import * as local from "./local.mjs";
import * as readme from "./readme.mjs";
import * as score from "./score.mjs";
import * as web from "./web.mjs";

const { UMO: umo, CHROMIUM: chromium, OUT: out } = process.env;
const speech = path.join(import.meta.dirname, "../../assets/hello.wav");
const suites = { file, judge, live, local, readme, score, web };
const names = process.argv.length > 2 ? process.argv.slice(2) : ["file", "judge", "live", "score"];

const at = (name) => path.join(out, name);
const run = (...args) => execFileSync(umo, args, { stdio: ["ignore", "ignore", "inherit"] });

fs.mkdirSync(out, { recursive: true });
const short = at("short.wav");
fs.writeFileSync(short, cut(fs.readFileSync(speech), 2.6));
const profile = fs.mkdtempSync(at("profile-"));
const browser = new Chromium(chromium, profile, short);
const context = { umo, run, at, browser, speech, short };
let failures = 0;
try {
  for (const name of names) {
    await suites[name].prepare?.(context);
    for (const [title, test] of suites[name].tests.filter(([title]) => title.match(process.env.ONLY ?? ""))) {
      const start = Date.now();
      const problem = await test(context).then(
        () => null,
        (error) => error,
      );
      console.log(`${problem ? "FAILED" : "ok"}  ${name}: ${title} (${((Date.now() - start) / 1000).toFixed(1)} s)`);
      if (problem) console.log(problem.stack);
      failures += problem ? 1 : 0;
    }
    await suites[name].end?.(context);
  }
} finally {
  await browser.close();
  fs.rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
}
console.log(failures === 0 ? "all passed" : `${failures} failed`);
process.exit(failures === 0 ? 0 : 1);
