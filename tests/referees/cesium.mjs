// 3D Tiles in CesiumJS, in a headless Chromium: all tiles that the view requests load, coarse ones
// before fine ones.
//
//     `NODE_FOLDER=PACKAGES node tests/referees/cesium.mjs CHROMIUM TILESET [SCREENSHOT.png]`
//
// `NODE_FOLDER` contains the package cesium, TILESET is a directory. SCREENSHOT.png is an image of
// the final view.

import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import fs from 'node:fs';
import http from 'node:http';
import os from 'node:os';
import path from 'node:path';

const [chromium, folder, picture] = process.argv.slice(2);
const cesium = path.join(process.env.NODE_FOLDER, 'node_modules/cesium/Build/Cesium');

const PAGE = `<!doctype html><body style="margin:0"><div id="view" style="width:400px;height:300px"></div>
<script>window.CESIUM_BASE_URL = '/cesium/';</script><script src="/cesium/Cesium.js"></script><script>
const told = { levels: [], failed: [] };
const tell = () => fetch('/told', { method: 'POST', body: JSON.stringify(told) });
window.onerror = (message) => { told.failed.push(String(message)); tell(); };
window.onunhandledrejection = ({ reason }) => { told.failed.push(String(reason)); tell(); };
(async () => {
  const scene = new Cesium.CesiumWidget('view', { baseLayer: false, skyBox: false, skyAtmosphere: false, globe: false,
    contextOptions: { webgl: { preserveDrawingBuffer: true } } }).scene;
  scene.backgroundColor = Cesium.Color.WHITE;
  const tileset = await Cesium.Cesium3DTileset.fromUrl('/tiles/tileset.json', { maximumScreenSpaceError: 2 });
  tileset.tileLoad.addEventListener(({ content }) => {
    // Subtrees are contents, too.
    const level = /content.([0-9]+)/.exec(content.url ?? '');
    if (level) told.levels.push(Number(level[1]));
  });
  tileset.tileFailed.addEventListener(({ url, message }) => told.failed.push(url + ': ' + message));
  scene.primitives.add(tileset);
  const { center, radius } = tileset.boundingSphere;
  scene.camera.lookAt(center, new Cesium.HeadingPitchRange(0.6, -0.5, 1.6 * radius));
  tileset.initialTilesLoaded.addEventListener(() => setTimeout(() => {
    told.triangles = tileset.statistics.numberOfTrianglesSelected;
    told.picture = scene.canvas.toDataURL('image/png');
    tell();
  }, 500));
})();
</script></body>`;

const asked = [];
const told = await new Promise((resolve, reject) => {
  const server = http.createServer((request, response) => {
    const { pathname } = new URL(request.url, 'http://x');
    const [, top, ...rest] = pathname.split('/');
    if (pathname === '/told') {
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
    const file = path.join({ cesium, tiles: folder }[top] ?? '/nowhere', ...rest);
    if (rest[0] === 'content') asked.push(rest.join('/'));
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
  const limit = setTimeout(() => finish(() => reject(new Error('nothing was told within 5 minutes'))), 300_000);
  server.listen(0, '127.0.0.1', () => {
    browser = spawn(chromium, ['--headless=new', '--no-sandbox', '--disable-dev-shm-usage', '--use-angle=swiftshader',
      '--enable-unsafe-swiftshader', `--user-data-dir=${profile}`, `http://127.0.0.1:${server.address().port}/`],
      { stdio: 'ignore' });
    browser.on('error', (error) => finish(() => reject(error)));
  });
});

assert.deepEqual(told.failed, []);
assert.equal(asked[0], 'content/0/0/0/0.glb', 'the coarsest is asked for first');
const finest = Math.max(...told.levels);
assert.ok(finest > 0, 'finer ones follow');
assert.ok(told.triangles > 0);
if (picture) fs.writeFileSync(picture, Buffer.from(told.picture.split(',')[1], 'base64'));
console.log(`Cesium: ${told.levels.length} tiles of levels 0 to ${finest}, ${told.triangles} triangles in view`);
