// 3D Tiles in CesiumJS, in a headless Chromium: all tiles that the view requests load, coarse ones
// before fine ones.
//
//     `NODE_DIRECTORY=PACKAGES node tests/referees/cesium.mjs CHROMIUM TILESET [SCREENSHOT.png]`
//
// `NODE_DIRECTORY` contains the package cesium, TILESET is a directory. SCREENSHOT.png is an image
// of the final view.

import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import fs from 'node:fs';
import http from 'node:http';
import os from 'node:os';
import path from 'node:path';

const [chromium, directory, screenshot] = process.argv.slice(2);
const cesium = path.join(process.env.NODE_DIRECTORY, 'node_modules/cesium/Build/Cesium');

const PAGE = `<!doctype html><body style="margin:0"><div id="view" style="width:400px;height:300px"></div>
<script>window.CESIUM_BASE_URL = '/cesium/';</script><script src="/cesium/Cesium.js"></script><script>
const found = { levels: [], failed: [] };
const report = () => fetch('/result', { method: 'POST', body: JSON.stringify(found) });
window.onerror = (message) => { found.failed.push(String(message)); report(); };
window.onunhandledrejection = ({ reason }) => { found.failed.push(String(reason)); report(); };
(async () => {
  const scene = new Cesium.CesiumWidget('view', { baseLayer: false, skyBox: false, skyAtmosphere: false, globe: false,
    contextOptions: { webgl: { preserveDrawingBuffer: true } } }).scene;
  scene.backgroundColor = Cesium.Color.WHITE;
  const tileset = await Cesium.Cesium3DTileset.fromUrl('/tiles/tileset.json', { maximumScreenSpaceError: 2 });
  tileset.tileLoad.addEventListener(({ content }) => {
    // Subtrees are contents, too.
    const level = /content.([0-9]+)/.exec(content.url ?? '');
    if (level) found.levels.push(Number(level[1]));
  });
  tileset.tileFailed.addEventListener(({ url, message }) => found.failed.push(url + ': ' + message));
  scene.primitives.add(tileset);
  const { center, radius } = tileset.boundingSphere;
  scene.camera.lookAt(center, new Cesium.HeadingPitchRange(0.6, -0.5, 1.6 * radius));
  tileset.initialTilesLoaded.addEventListener(() => setTimeout(() => {
    found.triangles = tileset.statistics.numberOfTrianglesSelected;
    found.screenshot = scene.canvas.toDataURL('image/png');
    report();
  }, 500));
})();
</script></body>`;

const requests = [];
const found = await new Promise((resolve, reject) => {
  const server = http.createServer((request, response) => {
    const { pathname } = new URL(request.url, 'http://x');
    const [, top, ...rest] = pathname.split('/');
    if (pathname === '/result') {
      const parts = [];
      request.on('data', (part) => parts.push(part));
      request.on('end', () => {
        response.end();
        finish(() => resolve(JSON.parse(Buffer.concat(parts).toString())));
      });
      return;
    }
    if (pathname === '/') {
      response.end(PAGE);
      return;
    }
    const file = path.join({ cesium, tiles: directory }[top] ?? '/nowhere', ...rest);
    if (rest[0] === 'content') requests.push(rest.join('/'));
    const types = { '.js': 'text/javascript', '.json': 'application/json', '.css': 'text/css' };
    response.setHeader('Content-Type', types[path.extname(file)] ?? 'application/octet-stream');
    response.statusCode = fs.existsSync(file) ? 200 : 404;
    response.end(response.statusCode === 200 ? fs.readFileSync(file) : undefined);
  });
  const profile = fs.mkdtempSync(path.join(os.tmpdir(), 'chromium-'));
  let browser;
  // Child processes of the browser may still write after it ends; what remains then is a temporary
  // directory.
  const remove = (times) => {
    try {
      fs.rmSync(profile, { recursive: true, force: true });
    } catch (error) {
      if (times > 0) setTimeout(() => remove(times - 1), 500);
      else console.log(`left ${profile}: ${error.code}`);
    }
  };
  const finish = (end) => {
    clearTimeout(limit);
    server.close();
    browser?.on('exit', () => remove(10));
    browser?.kill();
    server.closeAllConnections();
    end();
  };
  const limit = setTimeout(() => finish(() => reject(new Error('the page reported nothing within 5 minutes'))), 300_000);
  server.listen(0, '127.0.0.1', () => {
    browser = spawn(chromium, ['--headless=new', '--no-sandbox', '--disable-dev-shm-usage', '--use-angle=swiftshader',
      '--enable-unsafe-swiftshader', `--user-data-dir=${profile}`, `http://127.0.0.1:${server.address().port}/`],
      { stdio: 'ignore' });
    browser.on('error', (error) => finish(() => reject(error)));
  });
});

assert.deepEqual(found.failed, []);
assert.equal(requests[0], 'content/0/0/0/0.glb', 'the coarsest is requested first');
const finest = Math.max(...found.levels);
assert.ok(finest > 0, 'finer ones follow');
assert.ok(found.triangles > 0);
if (screenshot) fs.writeFileSync(screenshot, Buffer.from(found.screenshot.split(',')[1], 'base64'));
console.log(`Cesium: ${found.levels.length} tiles of levels 0 to ${finest}, ${found.triangles} triangles in view`);
