// The controls beside the view: fields, buttons, tables, and messages.

export const element = (id) => document.getElementById(id);

/** Adds a control with a name to the panel. */
export function field(name, control) {
  const label = document.createElement("label");
  label.className = "field";
  label.append(Object.assign(document.createElement("span"), { textContent: name }), control);
  element("fields").append(label);
  return label;
}

/** A list of which one thing is chosen: pairs of values and texts. */
export function choice(pairs, chosen, onChange) {
  const select = document.createElement("select");
  for (const [value, text] of pairs) select.add(new Option(text, value, false, value === chosen));
  select.addEventListener("change", () => onChange(select.value));
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

/** Fills a part of the panel under a heading. */
export function fill(id, heading, ...content) {
  const part = element(id);
  part.replaceChildren(Object.assign(document.createElement("h2"), { textContent: heading }), ...content);
  part.hidden = false;
}

/** A table: names of columns, and rows of texts. */
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

/** A number as people read it, never with digits that it does not have. */
export function text(number) {
  if (number === null || number === undefined) return "–";
  if (typeof number === "bigint" || Number.isInteger(number)) return number.toLocaleString("en");
  if (typeof number !== "number") return String(number);
  return Number(number.toPrecision(9)).toLocaleString("en", { maximumSignificantDigits: 9 });
}

let timer;

/** Tells of work that goes on; without arguments, that it has ended. */
export function working(progress) {
  clearTimeout(timer);
  const show = (line) => (element("work").textContent = line);
  if (!progress) return show("");
  const { requests, bytes } = progress;
  // (What takes less is not worth a word.)
  timer = setTimeout(() => show(`reading: ${text(requests)} requests, ${text(Math.round(bytes / 1000))} kB`), 150);
}

export function showRemarks(remarks) {
  element("remarks").textContent = remarks.join("\n");
  element("remarks").hidden = remarks.length === 0;
}

/** Shows an error; that somebody stopped what was under way is none. */
export function fail(error) {
  working();
  if (error?.name === "AbortError") return;
  const dialog = element("failure");
  dialog.querySelector("p").textContent = error?.message ?? String(error);
  if (!dialog.open) dialog.showModal();
}

/** Runs the newest of several jobs that replace each other: an older one is aborted. */
export function latest(job) {
  let controller;
  return async (...given) => {
    controller?.abort();
    const own = (controller = new AbortController());
    try {
      return await job(own.signal, ...given);
    } catch (error) {
      if (!own.signal.aborted) fail(error);
    } finally {
      if (controller === own) working();
    }
  };
}
