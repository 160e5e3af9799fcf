// The page: opens what its configuration names, and shows it as a map, a solid or an exact model.

import { element, fail, field, choice, showRemarks, working } from "./interface.js";
import { readPlace, writePlace } from "./place.js";
import { readFromParent, tellParent } from "./notebook.js";

const configuration = JSON.parse(document.getElementById("configuration").textContent);

/** The base64 that stands in the page under a name, where the page is one file; `undefined` where it is several. */
function embedded(name) {
  return document.querySelector(`script[data-name="${CSS.escape(name)}"]`)?.textContent;
}

function bytesOf(base64) {
  return Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
}

/** Where a file of the page is: beside it, or inside it. */
function assetUrl(name) {
  const base64 = embedded(name);
  if (base64 === undefined) return new URL(configuration.assets + name, document.baseURI).href;
  return URL.createObjectURL(new Blob([bytesOf(base64)], { type: "text/javascript" }));
}

/** The module, compiled as it comes where its host tells what it is. */
async function compiled(url) {
  const response = await fetch(url);
  if (!response.ok) return undefined;
  const isTold = response.headers.get("content-type") === "application/wasm";
  return isTold ? WebAssembly.compileStreaming(response) : WebAssembly.compile(await response.arrayBuffer());
}

/** The package. In a page that is one file, its worker and its module are inside. */
async function loadPackage() {
  const worker = embedded("worker");
  if (worker === undefined) {
    // (The module is on its way before the worker could ask for it.)
    const module = compiled(assetUrl("spinney/module_bg.wasm")).catch(() => undefined);
    const spinney = await import(assetUrl("spinney/index.js"));
    spinney.setWorker(() => {
      const started = new Worker(assetUrl("spinney/worker.js"), { type: "module", name: "spinney" });
      started.postMessage({ module: "later" });
      module.then((module) => started.postMessage({ module }));
      return started;
    });
    return spinney;
  }
  const spinney = await import("spinney/index.js");
  spinney.setWorker(() => {
    const started = new Worker(worker, { type: "module", name: "spinney" });
    started.postMessage({ module: bytesOf(embedded("spinney/module_bg.wasm")) });
    return started;
  });
  return spinney;
}

/** The module that shows what a file has. */
function viewOf({ kind, dimension }) {
  if (kind === "model") return import("./model.js");
  return dimension === 3 ? import("./solid.js") : import("./map.js");
}

let view;
let dataset;

/** Shows a dataset in place of what is shown. */
async function show(spinney, source, name, place) {
  view?.close();
  dataset?.close();
  view = dataset = undefined;
  for (const id of ["fields", "legend", "tools", "answer"]) element(id).replaceChildren();
  for (const id of ["legend", "tools", "answer"]) element(id).hidden = true;
  document.title = name;
  element("title").textContent = name;
  const options = { progress: working, ...(place.layer && { layer: place.layer }), ...(place.commit && { commit: Number(place.commit) }) };
  dataset = await spinney.openInWorker(source, options);
  showRemarks(dataset.warnings ?? []);
  const { header } = dataset;
  if (header.layers?.length > 1) {
    const names = header.layers.map((layer) => [layer.name, layer.name]);
    field("Layer", choice(names, header.layer, (layer) => reopen({ layer, style: undefined, hide: undefined })));
  }
  const shared = { dataset, place, assetUrl, reopen };
  view = await (await viewOf(header)).show(shared);
  working();

  function reopen(changes) {
    const next = { ...place, ...readPlace(), ...changes };
    writePlace(next);
    return show(spinney, source, name, next).catch(fail);
  }
}

async function start() {
  document.addEventListener("spinney-polygon", ({ detail }) => tellParent({ polygon: detail }));
  const theme = new URLSearchParams(location.search).get("theme");
  if (theme === "dark" || theme === "light") document.documentElement.dataset.theme = theme;
  const panel = element("panel");
  element("fold").addEventListener("click", () => {
    const isFolded = panel.classList.toggle("folded");
    element("fold").setAttribute("aria-expanded", String(!isFolded));
  });
  if (matchMedia("(max-width: 640px)").matches) element("fold").click();
  const spinney = await loadPackage();
  element("file").addEventListener("change", (event) => {
    const [file] = event.target.files;
    if (file) show(spinney, file, file.name, {}).catch(fail);
  });
  const sources = configuration.sources ?? [];
  const place = readPlace();
  const chosen = sources.find((source) => source.name === place.file) ?? sources[0];
  if (!chosen) return;
  const sourceOf = ({ name, url, size }) => {
    // (In a notebook whoever shows the page reads the file.)
    if (url === "parent:") return { name, size, read: readFromParent };
    const data = embedded(url);
    return data === undefined ? new URL(url, document.baseURI) : bytesOf(data);
  };
  // (What draws it needs nothing of the file.)
  if (chosen.isMap) import("./map.js").then(({ prepare }) => prepare(assetUrl)).catch(fail);
  // (Where the address says nothing, the page begins as whoever made it wanted.)
  const started = ({ layer, commit, style }) => Object.fromEntries(Object.entries({ layer, commit, style }).filter(([, value]) => value !== null));
  const open = (source, at) => show(spinney, sourceOf(source), source.title, { ...started(source), ...at });
  if (sources.length > 1) {
    const names = sources.map((source) => [source.name, source.title]);
    const select = choice(names, chosen.name, (name) => {
      writePlace({ file: name });
      open(sources.find((source) => source.name === name), { file: name }).catch(fail);
    });
    const label = document.createElement("label");
    label.className = "field";
    label.append(Object.assign(document.createElement("span"), { textContent: "File" }), select);
    element("controls").prepend(label);
  }
  await open(chosen, place);
}

start().then(() => document.documentElement.setAttribute("data-ready", ""), fail);
