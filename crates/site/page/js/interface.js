// The controls next to the view: fields, buttons, tables, and messages.

import { messageOf, withoutForeign } from "./messages.js";

export const element = (id) => document.getElementById(id);

/** Removes the panel's result of a position, a section or a polygon. */
export function clearResult() {
  element("result").hidden = true;
  element("result").replaceChildren();
}

/** Adds a labelled control to the panel. */
export function field(name, control) {
  const label = document.createElement("label");
  label.className = "field";
  label.append(Object.assign(document.createElement("span"), { textContent: name }), control);
  element("fields").append(label);
  return label;
}

/**
 * A list with one selected item. `items` are pairs of values and strings; a third element `true`
 * disables an item. If `onChange` returns (a promise of) `false`, the previous item is selected
 * again.
 */
export function choice(items, chosen, onChange) {
  const select = document.createElement("select");
  for (const [value, text, isDisabled] of items) {
    const option = new Option(text, value, false, value === chosen);
    option.disabled = Boolean(isDisabled);
    select.add(option);
  }
  let last = select.value;
  select.addEventListener("change", async () => {
    const value = select.value;
    if ((await onChange(value)) !== false) last = value;
    else if (select.value === value) select.value = last;
  });
  return select;
}

export function button(text, title, onClick) {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: text, title });
  made.addEventListener("click", onClick);
  return made;
}

/** A button that is on or off. */
export function toggle(text, title, onToggle) {
  const made = button(text, title, () => {
    const isOn = made.getAttribute("aria-pressed") !== "true";
    made.setAttribute("aria-pressed", String(isOn));
    onToggle(isOn);
  });
  made.setAttribute("aria-pressed", "false");
  return made;
}

export function slider(min, max, value, step, onInput) {
  const made = Object.assign(document.createElement("input"), { type: "range", min, max, step, value });
  made.addEventListener("input", () => onInput(Number(made.value)));
  return made;
}

/** Fills a section of the panel, below a heading, which is returned. */
export function fill(id, heading, ...content) {
  const part = element(id);
  const made = Object.assign(document.createElement("h2"), { textContent: heading });
  part.replaceChildren(made, ...content);
  part.hidden = false;
  return made;
}

/** A table with column names and rows of strings. */
export function table(columns, rows) {
  const made = document.createElement("table");
  const line = (parent, cells, kind) => {
    const row = parent.insertRow();
    for (const cell of cells) {
      const made = document.createElement(kind);
      made.append(cell instanceof Node ? cell : String(cell));
      row.append(made);
    }
  };
  if (columns.length) line(made.createTHead(), columns, "th");
  const body = made.createTBody();
  for (const row of rows) line(body, row, "td");
  return made;
}

export function paragraph(text, className = "") {
  return Object.assign(document.createElement("p"), { textContent: text, className });
}

/** A number formatted for display, never with digits that it does not have. */
export function text(number) {
  if (number === null || number === undefined) return "–";
  // (Never -0.)
  if (number === 0) return "0";
  if (typeof number === "bigint" || Number.isInteger(number)) return number.toLocaleString("en");
  if (typeof number !== "number") return String(number);
  return Number(number.toPrecision(9)).toLocaleString("en", { maximumSignificantDigits: 9 });
}

/** A number with a unit, or a power of a unit, if that is known. */
export function measured(number, unit, power = "") {
  return unit ? `${text(number)} ${unit}${power}` : text(number);
}

/**
 * Date and time in UTC of seconds since 1970; empty if there are none, or if they are beyond the
 * range of dates.
 */
export function dateAndTime(seconds) {
  if (seconds === null || seconds === undefined) return "";
  const date = new Date(Number(seconds) * 1000);
  return Number.isNaN(date.getTime()) ? "" : `${date.toISOString().replace("T", " ").replace(/\.\d+Z$/, "")} UTC`;
}

let timer;

/** Shows that work is in progress; without arguments, that it has ended. */
export function working(progress) {
  clearTimeout(timer);
  const show = (line) => (element("work").textContent = line);
  if (!progress) return show("");
  const { requests, bytes } = progress;
  // (Shorter work is not shown.)
  timer = setTimeout(() => show(`reading: ${text(requests)} requests, ${text(Math.round(bytes / 1000))} kB`), 150);
}

export function showRemarks(remarks) {
  element("remarks").textContent = remarks.map(withoutForeign).join("\n");
  element("remarks").hidden = remarks.length === 0;
}

/** Shows an error, unless it is a cancellation. */
export function fail(error) {
  working();
  if (error?.name === "AbortError") return;
  const dialog = element("failure");
  dialog.querySelector("p").textContent = messageOf(error);
  if (!dialog.open) dialog.showModal();
}

/** Abort controllers of the running jobs. */
const running = new Set();

/** Aborts all jobs, since the file that they read is closed. */
export function abortAll() {
  for (const controller of running) controller.abort();
}

/** Runs the newest of several jobs that replace each other: an older one is aborted. */
export function latest(job) {
  let controller;
  return async (...given) => {
    controller?.abort();
    const own = (controller = new AbortController());
    running.add(own);
    try {
      return await job(own.signal, ...given);
    } catch (error) {
      if (!own.signal.aborted) fail(error);
    } finally {
      running.delete(own);
      if (controller === own) working();
    }
  };
}
