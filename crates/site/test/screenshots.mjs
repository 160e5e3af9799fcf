// Takes the documentation's screenshots of the page: `SPINNEY_ROOT=. node screenshots.mjs`, copied
// to a directory that playwright-core is installed in (see ../test.sh).

import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";
import { serve } from "./server.mjs";

const root = process.env.SPINNEY_ROOT;
const directory = mkdtempSync(join(tmpdir(), "spinney-screenshots-"));
const spinney = (...list) => execFileSync(join(root, "target/debug/spinney"), list);
const fixture = (name) => join(root, "fixtures", name);
const size = { width: 760, height: 480 };

spinney("build", "-q", fixture("island_classes.tif"), "-o", join(directory, "island.goblin"));
spinney("export", "-q", join(directory, "island.goblin"), join(directory, "page_map/index.html"));
spinney("export", "-q", fixture("v1/ball.goblin"), join(directory, "page_solid/index.html"));
spinney("export", "-q", fixture("v1/chapel.goblin"), join(directory, "page_model/index.html"));
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"] });

async function capture(name, work) {
  const server = await serve(join(directory, name));
  const page = await browser.newPage({ viewport: size });
  await page.goto(`${server.url}index.html`);
  await page.waitForSelector("html[data-ready]");
  // (The viewport is smaller than a screen: hide or shrink what does not fit.)
  await page.addStyleTag({ content: "#open { display: none } #panel { width: 250px; font-size: 12px; max-height: 96% } #result { max-height: none } .classes button { min-height: 20px } footer { display: none !important }" });
  await page.waitForTimeout(1000);
  await work(page);
  await page.waitForTimeout(1500);
  await page.screenshot({ path: join(root, "docs/images", `${name}.png`) });
  await page.close();
  await server.close();
}

await capture("page_map", async (page) => {
  await page.click("text=Draw a polygon");
  for (const [x, y] of [[420, 130], [600, 170], [560, 330], [450, 300]]) await page.mouse.click(x, y);
  await page.click("text=Finish");
  await page.addStyleTag({ content: "#tools { display: none }" });
});
const cut = (axis, at) => async (page) => {
  await page.selectOption("label:has-text('Section') select", axis);
  await page.locator("input[type=range]").last().fill(String(at));
};
await capture("page_solid", cut("x", 0.6));
await capture("page_model", cut("y", 0.45));
await browser.close();
rmSync(directory, { recursive: true });
