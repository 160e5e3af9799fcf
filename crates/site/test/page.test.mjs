// Tests of the page in headless Chromium. Its results are compared with those of the program.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { copyFileSync, mkdirSync, readFileSync, readdirSync, statSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { before, test } from "node:test";
import { pathToFileURL } from "node:url";
import { at, directory, eventually, fixture, near, newPage, panelText, PHONE, pixel, program, programValue, ready, resultRows, root, spinney, visit } from "./browser.mjs";
import { serve } from "./server.mjs";

before(async () => {
  spinney("build", "-q", fixture("island_classes.tif"), "-o", at("island.goblin"));
  spinney("build", "-q", fixture("island_elevation.tif"), "-o", at("heights.goblin"));
  for (const name of ["island", "heights"]) spinney("export", "-q", at(`${name}.goblin`), at(`${name}/index.html`));
  spinney("export", "-q", "--style", "viridis", at("heights.goblin"), at("viridis/index.html"));
  for (const name of ["ball", "chapel", "rgb", "stack"]) spinney("export", "-q", fixture(`v1/${name}.goblin`), at(`${name}/index.html`));
  spinney("export", "-q", fixture("v1/history.autumn"), at("history/index.html"));
  spinney("export", "-q", "--self-contained", at("island.goblin"), at("island.html"));
});

/** Pixel of the desktop viewport in the interior of a large region of one class. */
const SNOW = [650, 350];

/** Waits for the map, clicks it, and returns the heading and rows of the result. */
async function click(page, [x, y]) {
  await eventually(async () => !near(await pixel(page, x, y), await pixel(page, 2, 400)), "the map appears");
  await page.mouse.click(x, y);
  await page.waitForSelector("#result table");
  const heading = await page.locator("#result h2").textContent();
  return { heading, rows: await resultRows(page) };
}

/** Returns the program's value at the position in a heading (latitude, longitude). */
function programValueAt(file, heading) {
  const [latitude, longitude] = heading.split(",").map(parseFloat);
  return programValue(file, "lonlat", [longitude, latitude]);
}

async function checkIslandValue(page) {
  const { heading, rows } = await click(page, SNOW);
  assert.equal(Number(rows["land cover"]), Number(programValueAt(at("island.goblin"), heading)));
}

test("a click shows the value that `spinney point` prints", () => visit("island", checkIslandValue));

test("a page that is one file opens from a disk", () => visit("island.html", checkIslandValue));

test("files of a host without ranges are read, with a remark", () =>
  visit("island", async (page) => {
    await checkIslandValue(page);
    assert.match(await page.locator("#remarks").textContent(), /range/i);
  }, { hasRanges: false }));

test("a drawn polygon has the statistics of `stats --zones`", () =>
  visit("island", async (page) => {
    await page.evaluate(() => document.addEventListener("spinney-polygon", ({ detail }) => (window.polygon = detail)));
    await page.click("text=Draw a polygon");
    for (const [x, y] of [[500, 200], [800, 250], [700, 500]]) await page.mouse.click(x, y, { delay: 10 });
    await page.click("text=Finish");
    await page.waitForFunction(() => window.polygon);
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
    await page.keyboard.press("Enter");
    for (const key of ["ArrowRight", "ArrowDown"]) {
      const before = page.url();
      await page.keyboard.press(key);
      await eventually(() => page.url() !== before, "the map has moved");
      await page.keyboard.press("Enter");
    }
    await page.click("text=Finish");
    await eventually(async () => (await panelText(page)).includes("cells"), "statistics of the polygon");
  }));

/** Draws a triangle and waits for its statistics. */
async function drawTriangle(page, corners) {
  await page.click("text=Draw a polygon");
  for (const [x, y] of corners) await page.mouse.click(x, y, { delay: 10 });
  await page.click("text=Finish");
  await eventually(async () => /cells/.test(await panelText(page)), "statistics of the polygon");
}

test("Clear and another polygon remove the statistics, and nothing else", () =>
  visit("island", async (page) => {
    const corners = [[500, 200], [800, 250], [700, 500]];
    for (const next of ["Clear", "Draw a polygon"]) {
      await drawTriangle(page, corners);
      await page.click(`text=${next}`);
      await page.waitForSelector("#result", { state: "hidden" });
      assert.equal(await panelText(page), "");
    }
    await page.click("text=Clear");
    await click(page, SNOW);
    await page.click("text=Clear");
    assert.ok(await page.locator("#result table").isVisible());
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
    const height = programValue(at("heights.goblin"), "world", [x, y]);
    assert.ok(Math.abs(Number(Object.values(rows)[0].replaceAll(",", "")) - height) < 0.01);
  }));

/** Locates a field of the panel by its label. */
const field = (page, name) => page.locator(`label.field:has(> span:text-is("${name}"))`);

/** Selects an item of a list in the panel, and waits until the file is shown again. */
async function chooseAndShow(page, name, value) {
  const old = await field(page, name).elementHandle();
  await field(page, name).locator("select").selectOption(value);
  await page.waitForFunction((old) => !old.isConnected, old);
  await page.waitForSelector("#tools button");
}

const settings = (page) => new URLSearchParams(new URL(page.url()).hash.slice(1));

/** Returns whether a class is shown according to the legend. */
const isShown = async (page, name) =>
  (await page.locator("#legend button").filter({ hasText: new RegExp(`^${name}$`) }).getAttribute("aria-pressed")) === "true";

test("classes that are shown again, and opacity, stay so in another grid", () =>
  visit("island", async (page) => {
    await page.waitForSelector("#legend button");
    assert.equal(await isShown(page, "6"), false);
    await page.locator("#legend button").filter({ hasText: /^6$/ }).click();
    await page.locator("#legend button").filter({ hasText: /^2$/ }).click();
    await field(page, "Opacity").locator("input").fill("0.4");
    for (const grid of ["native", "web-mercator"]) {
      await chooseAndShow(page, "Grid", grid);
      await page.waitForSelector("#legend button");
      assert.equal(await isShown(page, "6"), true);
      assert.equal(await isShown(page, "2"), false);
      assert.equal(await field(page, "Opacity").locator("input").inputValue(), "0.4");
      assert.equal(settings(page).get("hide"), "2");
    }
    await field(page, "Opacity").locator("input").fill("1");
    await page.locator("#legend button").filter({ hasText: /^2$/ }).click();
    await chooseAndShow(page, "Grid", "native");
    assert.equal(await field(page, "Opacity").locator("input").inputValue(), "1");
    assert.equal(settings(page).has("hide") || settings(page).has("opacity"), false);
  }, { hash: "#hide=6" }));

test("the file's own style stays in another grid, whatever style the page or the link starts with", async () => {
  const changeBack = async (page) => {
    const style = () => field(page, "Style").locator("select").inputValue();
    const started = await style();
    assert.match(started, /viridis/);
    await field(page, "Style").locator("select").selectOption("default");
    await chooseAndShow(page, "Grid", "native");
    assert.equal(await style(), "default");
    // (The page's link keeps the style, too.)
    await page.goto("about:blank");
    await page.goBack();
    await ready(page);
    assert.equal(await style(), "default");
    await field(page, "Style").locator("select").selectOption(started);
    await chooseAndShow(page, "Grid", "web-mercator");
    assert.equal(await style(), started);
  };
  await visit("heights", changeBack, { hash: "#style=viridis" });
  await visit("viridis", changeBack);
});

test("settings stay in another commit, and those of one file are not those of another", () =>
  visit("history", async (page) => {
    await page.waitForSelector("#legend button");
    await page.locator("#legend button").filter({ hasText: /^1$/ }).click();
    await field(page, "Changes since").locator("select").selectOption("1");
    await chooseAndShow(page, "Commit", "3");
    await page.waitForSelector("#legend button");
    assert.equal(await isShown(page, "1"), true);
    assert.equal(await field(page, "Changes since").locator("select").inputValue(), "1");
    await eventually(async () => /cells differ/.test(await field(page, "Changes since").textContent()), "changes are shown");
    await page.locator("#legend button").filter({ hasText: /^2$/ }).click();
    await page.setInputFiles("#file", at("island.goblin"));
    await page.waitForFunction(() => document.title === "island.goblin");
    await page.waitForSelector("#legend button");
    assert.equal(await isShown(page, "2"), true);
    for (const name of ["commit", "since", "hide"]) assert.equal(settings(page).has(name), false, name);
  }, { hash: "#hide=1" }));

test("sections stay in links", () =>
  visit("ball", async (page) => {
    assert.equal(await field(page, "Section").locator("select").inputValue(), "y");
    assert.equal(await field(page, "at").locator("input").inputValue(), "0.25");
    await field(page, "Section").locator("select").selectOption("");
    assert.equal(settings(page).has("section"), false);
  }, { hash: "#section=y:0.25" }));

test("swatches of all legends are seen", async () => {
  const swatches = (expected) => async (page) => {
    await eventually(async () => (await page.locator("#legend .swatch").count()) === expected, `${expected} swatches`);
    const boxes = await page.$$eval("#legend .swatch", (all) => all.map((one) => one.getBoundingClientRect()).map(({ width, height }) => [width, height]));
    for (const [width, height] of boxes) assert.ok(width >= 10 && height >= 10, `a swatch of ${width} x ${height}`);
  };
  await visit("rgb", swatches(3));
  await visit("heights", swatches(1), { hash: "#style=contours" });
  await visit("island", swatches(7));
});

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

test("commits have dates", () =>
  visit("history", async (page) => {
    const options = await field(page, "Commit").locator("option").allTextContents();
    const log = JSON.parse(spinney("log", fixture("v1/history.autumn"), "--json"));
    assert.equal(options.length, log.length);
    for (const { number, time, message } of log) {
      const date = time ? ` (1970-01-01 00:00:0${time} UTC)` : "";
      assert.ok(options.includes(`${number}${message && `: ${message}`}${date}`), `${number} in ${options}`);
    }
    assert.match(await field(page, "Commit").locator(".faint").textContent(), /^1970-01-01 00:00:03 UTC$/);
  }));

test("commits, and what changed since", () =>
  visit("history", async (page) => {
    const since = page.locator("label:has-text('Changes since')");
    await since.locator("select").selectOption("2");
    await eventually(async () => /cells differ/.test(await since.textContent()), "changes are shown");
    const found = JSON.parse(spinney("diff", `${fixture("v1/history.autumn")}@2`, fixture("v1/history.autumn"), "--json"));
    const cells = found.added + found.removed + found.changed;
    assert.match(await since.textContent(), new RegExp(`${cells} cells differ`));
    await page.locator("label:has-text('Commit') select").first().selectOption("2");
    await page.waitForFunction(() => location.hash.includes("commit=2"));
  }));

test("on a phone the map is seen while a polygon is drawn", () =>
  visit("island", async (page) => {
    await page.click("#fold");
    const height = async () => (await page.locator("#panel").boundingBox()).height;
    const open = await height();
    assert.ok(open > PHONE.height / 3);
    await page.click("text=Draw a polygon");
    assert.ok((await height()) < PHONE.height / 5, `the panel takes ${await height()}`);
    for (const [x, y] of [[100, 300], [300, 320], [200, 600]]) await page.mouse.click(x, y, { delay: 10 });
    await page.click("text=Finish");
    await eventually(async () => /cells/.test(await panelText(page)), "statistics of the polygon");
    assert.ok(await page.locator("#legend").isVisible());
    await page.click("text=Clear");
    await eventually(async () => (await height()) === open, "the panel is as it was");
  }, { viewport: PHONE }));

/**
 * Compares the view above the panel and its shadow with the background colour: `atEdge` is whether
 * something is drawn 2 pixels inside the edge, `width` the share of columns with something drawn.
 */
async function drawnParts(page) {
  const { y } = await page.locator("#panel").boundingBox();
  const shot = await page.screenshot({ clip: { x: 0, y: 0, width: PHONE.width, height: Math.floor(y) - 16 } });
  return page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const { width, height } = bitmap;
    const context = new OffscreenCanvas(width, height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const pixels = new Uint32Array(context.getImageData(0, 0, width, height).data.buffer);
    const isGround = (x, y) => pixels[y * width + x] === pixels[0];
    const [columns, rows] = [width, height].map((length) => Array.from({ length }, (_, at) => at));
    const atEdge = columns.some((x) => [2, height - 3].some((y) => !isGround(x, y))) || rows.some((y) => [2, width - 3].some((x) => !isGround(x, y)));
    const drawn = columns.filter((x) => rows.some((y) => !isGround(x, y)));
    return { atEdge, width: drawn.length / width };
  }, shot.toString("base64"));
}

test("solids and models fit a phone, whether the panel is open or not", async () => {
  const fits = async (page) => {
    for (const isOpen of [false, true]) {
      if (isOpen) await page.click("#fold");
      const fits = async () => {
        const { atEdge, width } = await drawnParts(page);
        return !atEdge && width > 0.2;
      };
      await eventually(fits, `it fits, ${isOpen ? "above the panel" : "with the panel folded"}`);
    }
  };
  for (const name of ["ball", "chapel"]) await visit(name, fits, { viewport: PHONE });
});

test("a file that the user selects is shown", () =>
  visit("island", async (page) => {
    await page.setInputFiles("#file", at("heights.goblin"));
    await page.waitForFunction(() => document.title === "heights.goblin");
    await eventually(async () => (await page.locator("#legend").textContent()).length > 0, "its legend");
  }));

test("in a notebook the kernel reads, and a polygon comes back", async () => {
  const size = statSync(at("island.goblin")).size;
  const html = readFileSync(at("island.html"), "utf8").replace('"url":"island.goblin"', '"url":"parent:"').replace('"size":null', `"size":${size}`);
  copyFileSync(join(root, "python/spinney/show.js"), at("island/show.js"));
  writeFileSync(at("island/inline.html"), html);
  // (A notebook's widget model: `send` passes a range to the kernel, which returns a message with
  // its bytes.)
  writeFileSync(at("island/notebook.html"), `<!doctype html><div id="cell"></div><script type="module">
    import widget from "./show.js";
    let heard;
    window.state = { _html: await (await fetch("inline.html")).text(), height: 600 };
    const model = {
      get: (name) => state[name], set: (name, value) => (state[name] = value), save_changes() {}, off() {},
      on: (name, hear) => (heard = hear),
      async send({ range, start, end }) {
        const response = await fetch("island.goblin", { headers: { range: \`bytes=\${start}-\${end - 1}\` } });
        heard({ range }, [new DataView(await response.arrayBuffer())]);
      },
    };
    widget.render({ model, el: document.getElementById("cell") });
  </script>`);
  const server = await serve(at("island"));
  const page = await newPage();
  await page.goto(`${server.url}notebook.html`);
  const frame = page.frameLocator("iframe");
  await frame.locator("#legend button").first().waitFor();
  await frame.locator("text=Draw a polygon").click();
  for (const [x, y] of [[500, 200], [800, 250], [700, 400]]) await page.mouse.click(x, y, { delay: 10 });
  await frame.locator("text=Finish").click();
  await page.waitForFunction(() => window.state._drawn);
  const { geometry, crs, zone } = JSON.parse(await page.evaluate(() => window.state._drawn));
  assert.equal(geometry.type, "Polygon");
  assert.equal(crs, "lonlat");
  assert.ok(zone.cells > 0);
  await page.close();
  await server.close();
});

test("a corrupt file is reported", async () => {
  writeFileSync(at("island/broken.goblin"), "no tree at all");
  const server = await serve(at("island"));
  const page = await newPage();
  await page.goto(`${server.url}index.html`);
  await ready(page);
  await page.setInputFiles("#file", at("island/broken.goblin"));
  await eventually(async () => /broken\.goblin/.test(await page.locator("#failure p").textContent()), "the message names the file");
  await page.close();
  await server.close();
});

/** Runs `spinney serve` on a directory while `work` uses its URL. */
async function withServer(directory, work) {
  const child = spawn(program, ["serve", directory, "--port", "0"], { stdio: ["ignore", "pipe", "ignore"] });
  const ended = new Promise((done) => child.on("exit", done));
  try {
    let printed = "";
    for await (const part of child.stdout) {
      printed += part;
      if (/http:\S+\s/.test(printed)) break;
    }
    await work(/http:\S+/.exec(printed)[0]);
  } finally {
    child.kill();
    await ended;
  }
}

test("points are listed as what no page shows, and the page starts with what it shows", async () => {
  mkdirSync(at("mixed"));
  spinney("build", "-q", fixture("island_points.laz"), "-o", at("mixed/a_points.goblin"));
  copyFileSync(at("island.goblin"), at("mixed/island.goblin"));
  await withServer(at("mixed"), async (url) => {
    const page = await newPage();
    await page.goto(url);
    await ready(page);
    assert.equal(await page.title(), "island");
    const options = await page.$$eval("#controls > label option", (all) => all.map(({ textContent, disabled }) => [textContent, disabled]));
    assert.deepEqual(options, [["a_points (points: not shown)", true], ["island", false]]);
    await page.close();
    // (A link may name a file that the page does not show.)
    const linked = await newPage();
    await linked.goto(`${url}#file=a_points.goblin`);
    await ready(linked);
    assert.match(await linked.locator("#failure p").textContent(), /a_points.* has points, which this page does not show/);
    await linked.close();
  });
  assert.throws(() => spinney("export", "-q", at("mixed/a_points.goblin"), at("nowhere/index.html")), /points.* make a raster from it/);
});

test("what cannot be opened is said in the page's terms, and what was shown stays", async () => {
  const server = await serve(at("island"));
  const page = await newPage();
  await page.goto(`${server.url}index.html`);
  await ready(page);
  spinney("build", "-q", fixture("island_points.laz"), "-o", at("points.goblin"));
  for (const [path, expected] of [[fixture("island_classes.tif"), /TIFF.*; this page opens \.goblin and \.autumn files$/], [at("points.goblin"), /points\.goblin: has points, which this page does not show/]]) {
    await page.setInputFiles("#file", path);
    await page.waitForSelector("#failure[open]");
    const message = await page.locator("#failure p").textContent();
    assert.match(message, expected);
    assert.doesNotMatch(message, COMMAND);
    await page.click("#failure button");
    assert.equal(await page.title(), "island");
    assert.ok(await page.locator("#legend button").first().isVisible());
  }
  await page.close();
  await server.close();
});

/** Matches commands and options of the program. */
const COMMAND = /`?\bspinney [a-z]|(^|[\s(`])--[a-z]/;

test("no advice of the engine reaches the page with a command or an option in it", async () => {
  const { messageOf, withoutForeign } = await import(pathToFileURL(join(root, "crates/site/page/js/messages.js")));
  let count = 0;
  for (const crate of ["base", "brep", "container", "crs", "engine", "packing", "records", "render", "report", "style"]) {
    const sources = join(root, "crates", crate, "src");
    for (const name of readdirSync(sources, { recursive: true }).filter((name) => name.endsWith(".rs"))) {
      // (Comments are removed: a quotation mark in one could be unpaired.)
      const code = readFileSync(join(sources, name), "utf8").replace(/^\s*\/\/.*$/gm, "");
      for (const [, literal] of code.matchAll(/"((?:[^"\\]|\\[^])*)"/g)) {
        if (!COMMAND.test(literal)) continue;
        count += 1;
        const advice = literal.replace(/\\\n\s*/g, "");
        const error = { code: "unsupported", file: "a.goblin", found: "something", advice, message: `a.goblin: something is not supported; ${advice}` };
        assert.doesNotMatch(messageOf(error), COMMAND);
        assert.match(messageOf(error), /^a\.goblin: something is not supported; /);
        assert.doesNotMatch(withoutForeign(`a.goblin: ${advice}`), COMMAND);
      }
    }
  }
  assert.ok(count > 50, `${count} messages`);
  const kept = "a.goblin: got 3 (of level 0), expected 0 to 2; choose another level";
  assert.equal(messageOf(new Error(kept)), kept);
});
