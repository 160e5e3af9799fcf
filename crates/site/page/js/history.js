// Commits of a file: which one is shown, and what changed since another.

import { choice, dateAndTime, field, latest, text, working } from "./interface.js";
import { changeSettings } from "./settings.js";

function label({ number, time, message }) {
  const date = dateAndTime(time);
  return `${number}${message ? `: ${message}` : ""}${date && ` (${date})`}`;
}

/** Adds the lists of commits, if the file has a history. */
export async function showHistory({ dataset, map, plane, place, reopen }) {
  if (dataset.header.format !== "autumnal") return;
  const commits = await dataset.commits();
  if (commits.length < 2) return;
  const shown = dataset.header.commit.number;
  const pairs = commits.map((commit) => [String(commit.number), label(commit)]);
  const newest = String(commits[0].number);
  const date = Object.assign(document.createElement("span"), { className: "faint", textContent: dateAndTime(dataset.header.commit.time) });
  field("Commit", choice(pairs, String(shown), (commit) => reopen({ commit: commit === newest ? undefined : commit }))).append(date);
  map.addSource("changes", { type: "geojson", data: { type: "FeatureCollection", features: [] } });
  map.addLayer({ id: "changes", type: "fill", source: "changes", paint: { "fill-color": "#e02f8a", "fill-opacity": 0.45, "fill-outline-color": "#e02f8a" } });
  const note = Object.assign(document.createElement("span"), { className: "faint" });
  const compare = latest(async (signal, other) => {
    changeSettings({ since: other });
    if (other === "") {
      note.textContent = "";
      return map.getSource("changes").setData({ type: "FeatureCollection", features: [] });
    }
    const found = await dataset.diff(Number(other), Number(shown), { signal, progress: working });
    note.textContent = `${text(found.changedCells)} cells differ`;
    const corners = found.blocks.flatMap(({ world: [[west, south], [east, north]] }) => [[west, south], [east, south], [east, north], [west, north], [west, south]]);
    const positions = await plane.degreesOfWorld(dataset, corners);
    const features = found.blocks
      .map((_, at) => positions.slice(5 * at, 5 * at + 5))
      .filter((ring) => ring.every(Boolean))
      .map((ring) => ({ type: "Feature", properties: {}, geometry: { type: "Polygon", coordinates: [ring] } }));
    if (found.blocks.length < found.blockCount) note.textContent += ` (${text(found.blocks.length)} of ${text(found.blockCount)} blocks are shown)`;
    map.getSource("changes").setData({ type: "FeatureCollection", features });
  });
  const others = pairs.filter(([id]) => id !== String(shown));
  const since = others.some(([id]) => id === place.since) ? place.since : "";
  field("Changes since", choice([["", "–"], ...others], since, compare)).append(note);
  compare(since);
}
