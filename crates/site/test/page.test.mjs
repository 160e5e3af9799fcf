// The page in headless Chromium: what it shows and answers is what the program tells.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { chromium } from "playwright-core";
import { serve } from "./server.mjs";

const root = process.env.SPINNEY_ROOT ?? fileURLToPath(new URL("../../..", import.meta.url));
const program = process.env.SPINNEY ?? join(root, "target/debug/spinney");
const folder = mkdtempSync(join(tmpdir(), "spinney-page-"));
const at = (name) => join(folder, name);
const fixture = (name) => join(root, "fixtures", name);
const spinney = (...list) => execFileSync(program, list, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });

/** The middle of the picture beside the panel, and what else is looked at. */
const DESKTOP = { width: 1200, height: 800 };
const PHONE = { width: 390, height: 800 };

let browser;

before(async () => {
  spinney("build", "-q", fixture("island_classes.tif"), "-o", at("island.goblin"));
  spinney("build", "-q", fixture("island_elevation.tif"), "-o", at("heights.goblin"));
  for (const name of ["island", "heights"]) spinney("export", "-q", at(`${name}.goblin`), at(`${name}/index.html`));
  for (const name of ["ball", "chapel", "stack"]) spinney("export", "-q", fixture(`v1/${name}.goblin`), at(`${name}/index.html`));
  spinney("export", "-q", fixture("v1/history.autumn"), at("history/index.html"));
  spinney("export", "-q", "--self-contained", at("island.goblin"), at("island.html"));
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
  rmSync(folder, { recursive: true, force: true });
});

/** Opens a page from a host of its own, or from the disk; afterwards there was no error, and nobody else was asked for anything. */
async function visit(place, work, { viewport = DESKTOP, hash = "", scheme = "light", ...host } = {}) {
  const server = place.endsWith(".html") ? undefined : await serve(at(place), host);
  const own = server?.url ?? pathToFileURL(at(place)).href;
  const page = await browser.newPage({ viewport, colorScheme: scheme });
  const problems = [];
  page.on("console", (message) => message.type() === "error" && problems.push(message.text()));
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("request", (request) => {
    const url = request.url();
    if (!url.startsWith(own) && !/^(data|blob):/.test(url)) problems.push(`a request to ${url}`);
  });
  try {
    await page.goto(own + (server ? `index.html${hash}` : hash));
    await page.waitForSelector("html[data-ready]", { timeout: 60_000 });
    await work(page, server);
    assert.equal(await page.locator("#failure p").textContent(), "");
    assert.deepEqual(problems, []);
  } finally {
    await page.close();
    await server?.close();
  }
}

/** The colour of a pixel of the page. */
async function pixel(page, x, y) {
  const shot = await page.screenshot({ clip: { x, y, width: 1, height: 1 } });
  return page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const context = new OffscreenCanvas(1, 1).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return [...context.getImageData(0, 0, 1, 1).data].slice(0, 3);
  }, shot.toString("base64"));
}

/** Waits until something is so; a page draws when it can. */
async function eventually(look, message) {
  for (let time = 0; time < 150; time += 1) {
    if (await look()) return;
    await new Promise((done) => setTimeout(done, 100));
  }
  assert.fail(message);
}

/** Rows of the table that answers. */
const answer = (page) =>
  page.evaluate(() => Object.fromEntries([...document.querySelectorAll("#answer tr")].map((row) => [...row.cells].map((cell) => cell.textContent))));

const near = (one, other) => one.every((part, index) => Math.abs(part - other[index]) <= 2);

/** A place of the island where one class lies all around. */
const SNOW = [650, 350];

/** Waits for the map and asks it for a value. */
async function click(page, [x, y]) {
  await eventually(async () => !near(await pixel(page, x, y), await pixel(page, 2, 400)), "the map appears");
  await page.mouse.click(x, y);
  await page.waitForSelector("#answer table");
  const heading = await page.locator("#answer h2").textContent();
  return { heading, rows: await answer(page) };
}

/** The value that the program tells of a place in a heading: latitude, longitude. */
function toldValue(file, heading) {
  const [latitude, longitude] = heading.split(",").map(parseFloat);
  return told(file, "lonlat", [longitude, latitude]);
}

/** The first sample that the program tells of a place; null where there is none. */
function told(file, coordinates, place) {
  const answer = JSON.parse(spinney("point", file, "--in", coordinates, "--json", "--", place.join(",")));
  return answer.layers[0].samples?.[0] ?? null;
}

async function islandAnswers(page) {
  const { heading, rows } = await click(page, SNOW);
  assert.equal(Number(rows["land cover"]), Number(toldValue(at("island.goblin"), heading)));
}

test("a click tells the value that `spinney point` tells", () => visit("island", islandAnswers));

test("a page that is one file opens from a disk", () => visit("island.html", islandAnswers));

test("a host without ranges is told of, and its files are read", () =>
  visit("island", async (page) => {
    await islandAnswers(page);
    assert.match(await page.locator("#remarks").textContent(), /range/i);
  }, { hasRanges: false }));

test("a polygon that is drawn has the statistics of `stats --zones`", () =>
  visit("island", async (page) => {
    await page.evaluate(() => document.addEventListener("spinney-polygon", ({ detail }) => (window.polygon = detail)));
    await page.click("text=Draw a polygon");
    for (const [x, y] of [[500, 200], [800, 250], [700, 500]]) await page.mouse.click(x, y, { delay: 10 });
    await page.click("text=Finish");
    await page.waitForFunction(() => window.polygon, undefined, { timeout: 30_000 });
    const { geometry, zone } = await page.evaluate(() => window.polygon);
    writeFileSync(at("zone.geojson"), JSON.stringify({ type: "Feature", properties: {}, geometry }));
    const [expected] = JSON.parse(spinney("stats", at("island.goblin"), "--zones", at("zone.geojson"), "--edge", "area", "--json")).zones;
    assert.ok(zone.classes.length >= 3);
    for (const [index, found] of zone.classes.entries()) {
      assert.equal(found.value, expected.classes[index].value);
      const { cells } = expected.classes[index];
      assert.ok(Math.abs(found.cells - cells) <= 1e-9 * expected.cells, `${found.cells} cells, ${cells} by the program`);
    }
  }));

test("polygons are drawn with keys alone", () =>
  visit("island", async (page) => {
    await page.click("text=Draw a polygon");
    await page.focus("canvas");
    for (const key of ["Enter", "ArrowRight", "ArrowDown"]) {
      await page.keyboard.press(key);
      await page.waitForTimeout(400);
      if (key !== "Enter") await page.keyboard.press("Enter");
    }
    await page.click("text=Finish");
    await eventually(async () => (await page.locator("#answer").textContent()).includes("cells"), "statistics of the polygon");
  }));

test("the legend hides a class and shows it again, and links keep it", () =>
  visit("island", async (page) => {
    const { rows } = await click(page, SNOW);
    const shown = await pixel(page, ...SNOW);
    const name = new RegExp(`^${rows["land cover"]}$`);
    const key = page.locator("#legend button").filter({ hasText: name });
    await key.click();
    await eventually(async () => !near(await pixel(page, ...SNOW), shown), "the class is hidden");
    assert.match(page.url(), new RegExp(`hide=${rows["land cover"]}`));
    await key.click();
    await eventually(async () => near(await pixel(page, ...SNOW), shown), "the class is shown");
  }));

test("styles and the file's own grid", () =>
  visit("heights", async (page) => {
    await click(page, SNOW);
    const before = await pixel(page, ...SNOW);
    await page.selectOption("label:has-text('Style') select", "hillshade");
    await eventually(async () => !near(await pixel(page, ...SNOW), before), "another style");
    await page.selectOption("label:has-text('Grid') select", "native");
    await page.waitForFunction(() => location.hash.includes("grid=native"));
    const { heading, rows } = await click(page, SNOW);
    const [x, y] = heading.split(",").map(parseFloat);
    const height = told(at("heights.goblin"), "world", [x, y]);
    assert.ok(Math.abs(Number(Object.values(rows)[0].replaceAll(",", "")) - height) < 0.01);
  }));

test("layers, in the dark, on a phone", () =>
  visit("stack", async (page) => {
    assert.equal(await page.getAttribute("#fold", "aria-expanded"), "false");
    await page.click("#fold");
    await page.selectOption("label:has-text('Layer') select", "height");
    await page.waitForFunction(() => location.hash.includes("layer=height"));
    await eventually(async () => (await page.locator("#legend h2").textContent()) === "m", "the layer's legend");
    const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    assert.ok(overflow <= 0, "nothing reaches beyond a phone's screen");
  }, { viewport: PHONE, scheme: "dark" }));

test("commits, and what changed since", () =>
  visit("history", async (page) => {
    const since = page.locator("label:has-text('Changes since')");
    await since.locator("select").selectOption("2");
    await eventually(async () => /cells differ/.test(await since.textContent()), "changes are told");
    const found = JSON.parse(spinney("diff", `${fixture("v1/history.autumn")}@2`, fixture("v1/history.autumn"), "--json"));
    const cells = found.added + found.removed + found.changed;
    assert.match(await since.textContent(), new RegExp(`${cells} cells differ`));
    await page.locator("label:has-text('Commit') select").first().selectOption("2");
    await page.waitForFunction(() => location.hash.includes("commit=2"));
  }));

/** Cuts what is shown along an axis. */
async function cut(page, middle) {
  await eventually(async () => !near(await pixel(page, ...middle), await pixel(page, 1190, 790)), "it is drawn");
  const before = await page.screenshot();
  await page.selectOption("label:has-text('Section') select", "x");
  await eventually(async () => !before.equals(await page.screenshot()), "it is cut");
}

test("a solid is drawn and cut, and tells its cells", () =>
  visit("ball", async (page) => {
    await cut(page, [750, 400]);
    await page.mouse.click(600, 400);
    await page.waitForSelector("#answer table");
    const { cell } = await answer(page);
    const [x, y, z] = cell.split(", ").map(Number);
    const expected = told(fixture("v1/ball.goblin"), "cells", [x, y, z]);
    assert.equal((await answer(page)).value, expected === null ? "none" : String(expected));
  }));

test("an exact model is drawn, measured and cut", () =>
  visit("chapel", async (page) => {
    await cut(page, [700, 320]);
    const volume = await page.evaluate(() => [...document.querySelectorAll("#tools tr")].find((row) => row.cells[0].textContent === "volume").cells[1].textContent);
    const expected = JSON.parse(spinney("stats", fixture("v1/chapel.goblin"), "--json"));
    assert.ok(Math.abs(parseFloat(volume.replaceAll(",", "")) / expected.volume - 1) < 1e-8);
    await eventually(async () => /area/.test(await page.locator("#answer").textContent()), "the section's area");
  }));

test("a file that somebody chooses is shown", () =>
  visit("island", async (page) => {
    await page.setInputFiles("#file", at("heights.goblin"));
    await page.waitForFunction(() => document.title === "heights.goblin");
    await eventually(async () => (await page.locator("#legend").textContent()).length > 0, "its legend");
  }));

test("a file that is damaged is told of", async () => {
  writeFileSync(at("island/broken.goblin"), "no tree at all");
  const server = await serve(at("island"));
  const page = await browser.newPage({ viewport: DESKTOP });
  await page.goto(`${server.url}index.html`);
  await page.waitForSelector("html[data-ready]");
  await page.setInputFiles("#file", at("island/broken.goblin"));
  await eventually(async () => /broken\.goblin/.test(await page.locator("#failure p").textContent()), "the message names the file");
  await page.close();
  await server.close();
});
