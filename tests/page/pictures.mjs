// The pictures of docs/view.md: the page, on a phone, and how it was made. UMO, CHROMIUM and OUT name the program, the browser
// and a folder, to which view.png, view-phone.png and view-made.png are written.

import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

import { Chromium, pictures } from "./chromium.mjs";

const { UMO: umo, CHROMIUM: chromium, OUT: out } = process.env;
const root = path.join(import.meta.dirname, "../..");
const speech = path.join(root, "assets/hello.wav");
// The default model's layout has no parts.
const parts = path.join(root, "models/umo-small/model.safetensors");
const SECONDS = 3.3;
const MEDIA = [
  { name: "prefers-reduced-motion", value: "reduce" },
  { name: "prefers-color-scheme", value: "dark" },
];
const PICTURES = [
  { name: "view", width: 1280, height: 800 },
  { name: "view-phone", width: 390, height: 844, phone: true, keys: ["1"] },
  { name: "view-made", width: 1440, height: 900, model: parts, keys: ["d"] },
];

const profile = fs.mkdtempSync(path.join(out, "profile-"));
const browser = new Chromium(chromium, profile, speech);
try {
  for (const { name, model, keys = [], ...screen } of PICTURES) {
    const html = path.join(out, `${name}.html`);
    execFileSync(umo, ["view", speech, "-o", html, "--no-open", ...(model ? ["--model", model] : [])]);
    const page = await browser.open(pathToFileURL(html).href, { ...screen, media: MEDIA });
    await page.ready();
    await page.value(`umo.seek(${SECONDS})`);
    for (const key of keys) await page.key(key);
    await pictures(page, 4);
    await page.picture(path.join(out, `${name}.png`));
    await page.close();
  }
} finally {
  await browser.close();
  fs.rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
}
