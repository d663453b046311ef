// Screenshots for docs/view.md (the page, on a phone, with details, and with a take's score) and close-ups of the clothes for
// docs/avatar.md. UMO, CHROMIUM and OUT name the program, the browser and a folder, to which view.png, view-phone.png,
// view-made.png, view-score.png and cloth-0.png to cloth-2.png are written; arguments select some of these (`view`,
// `view-phone`, `view-made`, `view-score`, `cloth`).

import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

import { Chromium, pictures } from "./chromium.mjs";

const { UMO: umo, CHROMIUM: chromium, OUT: out } = process.env;
const root = path.join(import.meta.dirname, "../..");
const speech = path.join(root, "assets/hello.wav");
const SECONDS = 3.3;
const CLIP = { width: 640, height: 760 };
const PICTURES = [
  { name: "view", width: 1280, height: 800 },
  { name: "view-phone", width: 390, height: 844, phone: true, keys: ["1"] },
  { name: "view-made", width: 1440, height: 900, keys: ["d"] },
  { name: "view-score", width: 1280, height: 800, keys: ["d", "n"], isTake: true },
  { name: "cloth-0", width: 3600, height: 3600, light: true, seconds: 1.5, clip: { x: 2160, y: 1350, ...CLIP } },
  { name: "cloth-1", width: 3600, height: 3600, light: true, seconds: 1.5, figure: "bea", clip: { x: 1440, y: 1050, ...CLIP } },
  { name: "cloth-2", width: 3600, height: 3600, light: true, seconds: 1.5, figure: "bea", clip: { x: 1440, y: 2570, ...CLIP } },
];
/** Words of the recording. */
const WORDS = "Hello, it is so good to meet you! I am your new avatar. When I speak, my face, my hands and my whole body move with me.";
const wanted = process.argv.slice(2);

const profile = fs.mkdtempSync(path.join(out, "profile-"));
const browser = new Chromium(chromium, profile, speech);
try {
  for (const { name, figure, light, clip, isTake, seconds = SECONDS, keys = [], ...screen } of PICTURES) {
    if (wanted.length > 0 && !wanted.includes(name.replace(/-\d$/, ""))) continue;
    const html = path.join(out, `${name}.html`);
    const options = figure ? ["--figure", figure] : [];
    const take = path.join(out, "hello.umo");
    if (isTake) {
      fs.writeFileSync(path.join(out, "hello.txt"), WORDS);
      execFileSync(umo, ["animate", speech, "--words", path.join(out, "hello.txt"), "--seed", "3", "-o", take]);
    }
    execFileSync(umo, ["view", ...(isTake ? [take, "--audio", speech] : [speech]), "-o", html, "--no-open", ...options]);
    const media = [
      { name: "prefers-reduced-motion", value: "reduce" },
      { name: "prefers-color-scheme", value: light ? "light" : "dark" },
    ];
    const page = await browser.open(pathToFileURL(html).href, { ...screen, media });
    await page.ready();
    await page.value(`umo.seek(${seconds})`);
    for (const key of keys) await page.key(key);
    await pictures(page, 4);
    await page.picture(path.join(out, `${name}.png`), clip);
    await page.close();
  }
} finally {
  await browser.close();
  fs.rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
}
