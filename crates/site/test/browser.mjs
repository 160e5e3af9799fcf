// What the tests of the page share: the program, headless Chromium, and pages in it.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { chromium } from "playwright-core";
import { serve } from "./server.mjs";

export const root = process.env.SPINNEY_ROOT ?? fileURLToPath(new URL("../../..", import.meta.url));
export const program = process.env.SPINNEY ?? join(root, "target/debug/spinney");
export const directory = mkdtempSync(join(tmpdir(), "spinney-page-"));
export const at = (name) => join(directory, name);
export const fixture = (name) => join(root, "fixtures", name);
export const spinney = (...list) => execFileSync(program, list, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });

/** Viewport sizes in CSS pixels. */
const DESKTOP = { width: 1200, height: 800 };
export const PHONE = { width: 390, height: 844 };

let browser;

before(async () => {
  browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: [
      "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
      "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    ],
  });
});

after(async () => {
  await browser?.close();
  rmSync(directory, { recursive: true, force: true });
});

/** Opens a browser page. Its timeout of 60 s allows for busy machines. */
export async function newPage(options = { viewport: DESKTOP }) {
  const page = await browser.newPage(options);
  page.setDefaultTimeout(60_000);
  return page;
}

/** Waits until an opened page is ready. */
export const ready = (page) => page.waitForSelector("html[data-ready]");

/**
 * Opens a page from its own host, or a single file from the disk, and runs `work`. Fails if there
 * was an error, or a request to another host.
 */
export async function visit(place, work, { viewport = DESKTOP, hash = "", scheme = "light", ...host } = {}) {
  const server = place.endsWith(".html") ? undefined : await serve(at(place), host);
  const own = server?.url ?? pathToFileURL(at(place)).href;
  const page = await newPage({ viewport, colorScheme: scheme });
  const problems = [];
  page.on("console", (message) => message.type() === "error" && problems.push(message.text()));
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("request", (request) => {
    const url = request.url();
    if (!url.startsWith(own) && !/^(data|blob):/.test(url)) problems.push(`a request to ${url}`);
  });
  try {
    await page.goto(own + (server ? `index.html${hash}` : hash));
    await ready(page);
    await work(page, server);
    assert.equal(await page.locator("#failure p").textContent(), "");
    assert.deepEqual(problems, []);
  } finally {
    await page.close();
    await server?.close();
  }
}

/** Returns the colour of a pixel of the page: red, green, blue. */
export async function pixel(page, x, y) {
  const shot = await page.screenshot({ clip: { x, y, width: 1, height: 1 } });
  return page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const context = new OffscreenCanvas(1, 1).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return [...context.getImageData(0, 0, 1, 1).data].slice(0, 3);
  }, shot.toString("base64"));
}

/** Calls `poll` every 100 ms, since pages draw asynchronously. Fails after 600 polls. */
export async function eventually(poll, message) {
  for (let time = 0; time < 600; time += 1) {
    if (await poll()) return;
    await new Promise((done) => setTimeout(done, 100));
  }
  assert.fail(message);
}

/** Returns the rows of the result table as an object. */
export const resultRows = (page) =>
  page.evaluate(() => Object.fromEntries([...document.querySelectorAll("#result tr")].map((row) => [...row.cells].map((cell) => cell.textContent))));

/** Returns the panel's result for a position, section or polygon. */
export const panelText = (page) => page.locator("#result").textContent();

export const near = (one, other) => one.every((part, index) => Math.abs(part - other[index]) <= 2);

/** Returns the program's first sample at a position, or null if there is none. */
export function programValue(file, coordinates, place) {
  const report = JSON.parse(spinney("point", file, "--in", coordinates, "--json", "--", place.join(",")));
  return report.layers[0].samples?.[0] ?? null;
}
