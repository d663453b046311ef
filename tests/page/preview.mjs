// Frames of the page for docs/img/preview.webp: `half-000.png` etc. for half body, `whole-000.png` etc. for whole body; of
// a conversation `all-000.png` etc. UMO, CHROMIUM and OUT name the program, the browser and a folder; SPEECH a recording, or
// one of each member in lines; START, RATE and SECONDS determine the frames.

import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

import { Chromium, pictures } from "./chromium.mjs";

const { UMO: umo, CHROMIUM: chromium, OUT: out, SPEECH: speech, RATE: rate, SECONDS: seconds, START: start } = process.env;
const voices = speech.split("\n");
const MEDIA = [
  { name: "prefers-reduced-motion", value: "reduce" },
  { name: "prefers-color-scheme", value: "dark" },
];
const ONE = { half: { width: 420, height: 400 }, whole: { width: 250, height: 400 } };
/** Two members who stand at an angle, as on a stage. */
const HALF_TURNED = voices.length === 2 ? ["--places", "-0.55,0,60 0.55,0,-60"] : [];
const VIEWS = voices.length > 1 ? { all: { width: 560, height: 400 } } : ONE;

const html = path.join(out, "preview.html");
if (voices.length > 1) execFileSync(umo, ["converse", ...voices, "-o", html, "--figure", "bea,alex", ...HALF_TURNED]);
else execFileSync(umo, ["view", speech, "-o", html, "--no-open"]);
const profile = fs.mkdtempSync(path.join(out, "profile-"));
const browser = new Chromium(chromium, profile, voices[0]);
try {
  for (const [name, size] of Object.entries(VIEWS)) {
    const page = await browser.open(pathToFileURL(html).href, { ...size, media: MEDIA });
    await page.ready();
    // The avatar alone.
    await page.value(`document.head.append(Object.assign(document.createElement("style"), {
      textContent: "header, #transport { display: none !important }",
    })), window.dispatchEvent(new Event("resize"))`);
    await page.value(`umo.camera(${JSON.stringify(name)})`);
    for (let i = 0; i < Math.round(rate * seconds); i++) {
      await page.value(`umo.seek(${Number(start) + i / rate})`);
      await pictures(page, 1);
      await page.picture(path.join(out, `${name}-${String(i).padStart(3, "0")}.png`));
    }
    await page.close();
  }
} finally {
  await browser.close();
  fs.rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
}
