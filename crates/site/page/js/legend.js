// The legend: colours of classes, which a click hides, and of continuous values.

import { fill } from "./interface.js";

/** Classes that the address hides. */
export function hiddenClasses(list) {
  return new Set((list ?? "").split(",").filter(Boolean).map(Number));
}

const css = ([red, green, blue, opacity = 255]) => `rgb(${red} ${green} ${blue} / ${opacity / 255})`;

function swatch(colour) {
  const made = Object.assign(document.createElement("span"), { className: "swatch" });
  made.style.background = css(colour);
  return made;
}

/**
 * Shows a legend. `onHide` is called when classes were hidden or shown again; without it they
 * cannot be hidden.
 */
export function showLegend({ title, sections }, hidden, onHide) {
  const parts = sections.map((section) => (section.classes ? classes(section, hidden, onHide) : ramp(section.ramp)));
  if (parts.length) fill("legend", title || sections[0].title || "Legend", ...parts);
}

function classes({ classes }, hidden, onHide) {
  const list = Object.assign(document.createElement("ul"), { className: "classes" });
  for (const { value, label, colour } of classes) {
    const item = document.createElement("li");
    if (value === undefined || value === null || !onHide) {
      item.append(swatch(colour), label);
    } else {
      const made = Object.assign(document.createElement("button"), { type: "button", title: "Hide or show" });
      made.append(swatch(colour), label);
      made.setAttribute("aria-pressed", String(!hidden.has(value)));
      made.addEventListener("click", () => {
        if (!hidden.delete(value)) hidden.add(value);
        made.setAttribute("aria-pressed", String(!hidden.has(value)));
        onHide();
      });
      item.append(made);
    }
    list.append(item);
  }
  return list;
}

function ramp({ stops, ticks }) {
  const made = document.createElement("div");
  const bar = Object.assign(document.createElement("div"), { className: "ramp" });
  bar.style.background = `linear-gradient(to right, ${stops.map(css).join(", ")})`;
  const labels = Object.assign(document.createElement("div"), { className: "ticks" });
  labels.append(...ticks.map(({ label }) => Object.assign(document.createElement("span"), { textContent: label })));
  made.append(bar, labels);
  return made;
}
