// The page: opens the configured file, and shows it as a map, a solid or an exact model.

import { abortAll, element, fail, field, choice, showRemarks, working } from "./interface.js";
import { currentSettings, joined, readSettings, startSettings } from "./settings.js";
import { isShown, notShown } from "./messages.js";
import { readFromParent, postToParent } from "./notebook.js";

const configuration = JSON.parse(document.getElementById("configuration").textContent);

/**
 * Base64 data that a single-file page embeds under a name; `undefined` in a page of several files.
 */
function embedded(name) {
  return document.querySelector(`script[data-name="${CSS.escape(name)}"]`)?.textContent;
}

function bytesOf(base64) {
  return Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
}

/** URL of a file of the page: next to it, or embedded in it. */
function assetUrl(name) {
  const base64 = embedded(name);
  if (base64 === undefined) return new URL(configuration.assets + name, document.baseURI).href;
  return URL.createObjectURL(new Blob([bytesOf(base64)], { type: "text/javascript" }));
}

/** The compiled module, compiled while it is received if its host sends the right content type. */
async function compiled(url) {
  const response = await fetch(url);
  if (!response.ok) return undefined;
  const hasMediaType = response.headers.get("content-type") === "application/wasm";
  return hasMediaType ? WebAssembly.compileStreaming(response) : WebAssembly.compile(await response.arrayBuffer());
}

/** The package. A single-file page embeds its worker and its module. */
async function loadPackage() {
  const worker = embedded("worker");
  if (worker === undefined) {
    // (The module's download starts before the worker could request it.)
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

/** The module that shows a kind of file. */
function viewOf({ kind, dimension }) {
  if (kind === "model") return import("./model.js");
  return dimension === 3 ? import("./solid.js") : import("./map.js");
}

let view;
let dataset;

/** Files are opened sequentially, whatever is selected meanwhile. */
let queue = Promise.resolve();

/**
 * Shows a file with settings; `configured` are those of the configuration. If the file cannot be
 * opened, the previous one stays.
 */
function show(spinney, source, name, configured, settings) {
  const done = queue.then(() => showNow(spinney, source, name, configured, settings));
  queue = done.catch(() => {});
  return done;
}

async function showNow(spinney, source, name, configured, settings) {
  const { layer, commit } = settings;
  const options = { progress: working, ...(layer && { layer }), ...(commit && { commit: Number(commit) }) };
  const opened = await spinney.openInWorker(source, options);
  abortAll();
  view?.close();
  dataset?.close();
  view = undefined;
  dataset = opened;
  startSettings(configured, settings);
  for (const id of ["fields", "legend", "tools", "result"]) element(id).replaceChildren();
  for (const id of ["legend", "tools", "result"]) element(id).hidden = true;
  element("value").textContent = "";
  document.title = name;
  element("title").textContent = name;
  showRemarks(dataset.warnings ?? []);
  const { header } = dataset;
  /** Shows the file again with other settings; returns whether that succeeded. */
  const reopen = (changes) => succeeds(show(spinney, source, name, configured, { ...currentSettings(), ...changes }));
  if (header.layers?.length > 1) {
    const names = header.layers.map((layer) => [layer.name, layer.name]);
    field("Layer", choice(names, header.layer, (layer) => reopen({ layer, style: undefined, hide: undefined })));
  }
  view = await (await viewOf(header)).show({ dataset, place: currentSettings(), assetUrl, reopen });
  working();
}

/** Waits for a file to be shown; returns whether it was, and shows an error in a dialog. */
function succeeds(shown) {
  return shown.then(() => true, (error) => {
    fail(error);
    return false;
  });
}

async function start() {
  document.addEventListener("spinney-polygon", ({ detail }) => postToParent({ polygon: detail }));
  const theme = new URLSearchParams(location.search).get("theme");
  if (theme === "dark" || theme === "light") document.documentElement.dataset.theme = theme;
  const panel = element("panel");
  element("fold").addEventListener("click", () => {
    const isFolded = panel.classList.toggle("folded");
    element("fold").setAttribute("aria-expanded", String(!isFolded));
  });
  if (matchMedia("(max-width: 640px)").matches) element("fold").click();
  const spinney = await loadPackage();
  const sources = configuration.sources ?? [];
  const said = readSettings();
  const named = sources.find((source) => source.name === said.file);
  const chosen = named ?? sources.find(({ content }) => isShown(content)) ?? sources[0];
  const sourceOf = ({ name, url, size }) => {
    // (In a notebook the enclosing page reads the file.)
    if (url === "parent:") return { name, size, read: readFromParent };
    const data = embedded(url);
    return data === undefined ? new URL(url, document.baseURI) : bytesOf(data);
  };
  /** Shows a file of the configuration, which has defaults for missing settings. */
  const open = async (source, settings) => {
    if (!isShown(source.content)) throw new Error(notShown(source.title, source.content));
    const { layer, commit, style } = source;
    const configured = { layer, commit, style };
    await show(spinney, sourceOf(source), source.title, configured, joined(configured, settings));
  };
  let files;
  if (sources.length > 1) {
    const items = sources.map(({ name, title, content }) => [name, isShown(content) ? title : `${title} (${content}: not shown)`, !isShown(content)]);
    files = choice(items, chosen.name, (name) => succeeds(open(sources.find((source) => source.name === name), { file: name })));
    const label = document.createElement("label");
    label.className = "field";
    label.append(Object.assign(document.createElement("span"), { textContent: "File" }), files);
    element("controls").prepend(label);
  }
  element("file").addEventListener("change", async ({ target }) => {
    const [file] = target.files;
    // (The file is not in the list.)
    if (file && (await succeeds(show(spinney, file, file.name, {}, {}))) && files) files.value = "";
  });
  if (!chosen) return;
  // (The map library can be loaded before the file.)
  if (chosen.content === "map") import("./map.js").then(({ prepare }) => prepare(assetUrl)).catch(fail);
  const isShowing = await succeeds(open(chosen, said));
  if (!isShowing && files) files.value = "";
}

start().then(() => document.documentElement.setAttribute("data-ready", ""), fail);
