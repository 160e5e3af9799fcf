// Tests of the page of solids and exact models, compared with the program.

import assert from "node:assert/strict";
import { statSync, writeFileSync } from "node:fs";
import { before, test } from "node:test";
import { at, eventually, fixture, near, panelText, pixel, programValue, resultRows, spinney, visit } from "./browser.mjs";

before(() => {
  for (const name of ["ball", "chapel"]) spinney("export", "-q", fixture(`v1/${name}.goblin`), at(`${name}/index.html`));
  writeFileSync(at("tori.obj"), tori());
  spinney("build", "-q", at("tori.obj"), "-o", at("tori.goblin"), "--brep", "--snap", "0.00001", "--levels", "--unit", "m");
  spinney("export", "-q", at("tori.goblin"), at("tori/index.html"));
});

/** Two bumpy tori of 40,000 triangles each, as an OBJ with the objects `left` and `right`. */
function tori() {
  const [n, m] = [200, 100];
  const lines = [];
  for (const [index, name] of ["left", "right"].entries()) {
    lines.push(`o ${name}`);
    const number = (i, j) => index * n * m + (i % n) * m + (j % m) + 1;
    for (let i = 0; i < n; i += 1) {
      for (let j = 0; j < m; j += 1) {
        const [u, v] = [(2 * Math.PI * i) / n, (2 * Math.PI * j) / m];
        const r = 1 + 0.03 * Math.sin(12 * u) * Math.cos(9 * v);
        const position = [9 * index + (3 + r * Math.cos(v)) * Math.cos(u), (3 + r * Math.cos(v)) * Math.sin(u), r * Math.sin(v)];
        lines.push(`v ${position.map((at) => at.toFixed(6)).join(" ")}`);
      }
    }
    for (let i = 0; i < n; i += 1) {
      for (let j = 0; j < m; j += 1) {
        const [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
        lines.push(`f ${a} ${b} ${c}`, `f ${a} ${c} ${d}`);
      }
    }
  }
  return `${lines.join("\n")}\n`;
}

/** Waits until `middle` is drawn, and cuts the view by a section along x. */
async function cut(page, middle) {
  await eventually(async () => !near(await pixel(page, ...middle), await pixel(page, 1190, 790)), "it is drawn");
  const before = await page.screenshot();
  await page.selectOption("label:has-text('Section') select", "x");
  await eventually(async () => !before.equals(await page.screenshot()), "it is cut");
}

test("a solid is drawn and cut, and a click shows its cell", () =>
  visit("ball", async (page) => {
    await cut(page, [750, 400]);
    await page.mouse.click(600, 400);
    await page.waitForSelector("#result table");
    const { cell } = await resultRows(page);
    const [x, y, z] = cell.split(", ").map(Number);
    const expected = programValue(fixture("v1/ball.goblin"), "cells", [x, y, z]);
    assert.equal((await resultRows(page)).value, expected === null ? "none" : String(expected));
  }));

test("an exact model is drawn, measured and cut", () =>
  visit("chapel", async (page) => {
    await cut(page, [700, 320]);
    const volume = await page.evaluate(() => [...document.querySelectorAll("#tools tr")].find((row) => row.cells[0].textContent === "volume").cells[1].textContent);
    const expected = JSON.parse(spinney("stats", fixture("v1/chapel.goblin"), "--json"));
    assert.ok(Math.abs(parseFloat(volume.replaceAll(",", "")) / expected.volume - 1) < 1e-8);
    await eventually(async () => /area/.test(await panelText(page)), "the section's area");
    await page.locator("input[type=range]").fill("0.3");
    await eventually(async () => /^[1-9][\d,.]* m²$/.test((await resultRows(page)).area), "an area with its unit");
    assert.match((await resultRows(page)).at, / m$/);
  }));

/** Returns the number of triangles that the page of a model with levels of detail shows. */
const shownTriangles = (page) =>
  page.evaluate(() => {
    const row = [...document.querySelectorAll("#tools tr")].find((row) => row.cells[0].textContent === "shown");
    return parseFloat(row.cells[1].textContent.replaceAll(",", ""));
  });

test("a model with levels of detail is refined as the camera comes closer, and coarse objects have names", () =>
  visit("tori", async (page, server) => {
    const bytes = () => server.requests.filter(({ path }) => path.endsWith(".goblin")).reduce((sum, { sent }) => sum + sent, 0);
    const size = statSync(at("tori.goblin")).size;
    // (Fewer faces than the model has suffice for an error of a pixel.)
    await page.waitForTimeout(1000);
    const first = await shownTriangles(page);
    assert.ok(first > 1000 && first < 60_000, `${first} triangles`);
    assert.ok(bytes() < size / 2, `${bytes()} of ${size} bytes`);
    for (const [name, [x, y]] of Object.entries({ left: [620, 400], right: [900, 530] })) {
      assert.ok(!near(await pixel(page, x, y), await pixel(page, 400, 700)), `${name} is drawn`);
      await page.mouse.click(x, y);
      await eventually(async () => (await page.locator("#result h2").textContent()) === name, `the name of ${name}`);
    }
    await cut(page, [620, 400]);
    await eventually(async () => /area/.test(await panelText(page)), "the section's area");
    await page.selectOption("label:has-text('Section') select", "");
    await page.focus("canvas");
    for (let time = 0; time < 6; time += 1) await page.keyboard.press("+");
    await eventually(async () => (await shownTriangles(page)) > first, "more triangles near the camera");
    for (let time = 0; time < 16; time += 1) await page.keyboard.press("-");
    await eventually(async () => (await shownTriangles(page)) < first, "fewer triangles far from the camera");
  }));
