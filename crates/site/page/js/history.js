// Commits of a file: which one is shown, and what changed since another.

import { choice, field, latest, text, working } from "./interface.js";

const label = ({ id, time, message }) => `${id}${message ? `: ${message}` : ""}${time ? ` (${new Date(time).toISOString().slice(0, 10)})` : ""}`;

/** Adds the lists of commits, if the file has a history. */
export async function showHistory({ dataset, map, plane, reopen }) {
  if (dataset.header.format !== "autumnal") return;
  const commits = await dataset.commits();
  if (commits.length < 2) return;
  const shown = dataset.header.commit ?? commits[0].id;
  const pairs = commits.map((commit) => [String(commit.id), label(commit)]);
  field("Commit", choice(pairs, String(shown), (commit) => reopen({ commit: commit === String(commits[0].id) ? undefined : commit })));
  map.addSource("changes", { type: "geojson", data: { type: "FeatureCollection", features: [] } });
  map.addLayer({ id: "changes", type: "fill", source: "changes", paint: { "fill-color": "#e02f8a", "fill-opacity": 0.45, "fill-outline-color": "#e02f8a" } });
  const note = Object.assign(document.createElement("span"), { className: "faint" });
  const compare = latest(async (signal, other) => {
    if (other === "") {
      note.textContent = "";
      return map.getSource("changes").setData({ type: "FeatureCollection", features: [] });
    }
    const found = await dataset.diff(Number(other), Number(shown), {}, { signal, progress: working });
    note.textContent = `${text(found.changedCells)} cells differ`;
    const corners = found.boxes.flatMap(({ cells: [x0, y0, x1, y1] }) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]);
    const places = await plane.degreesOfCells(dataset, corners);
    const features = found.boxes
      .map((_, at) => places.slice(5 * at, 5 * at + 5))
      .filter((ring) => ring.every(Boolean))
      .map((ring) => ({ type: "Feature", properties: {}, geometry: { type: "Polygon", coordinates: [ring] } }));
    map.getSource("changes").setData({ type: "FeatureCollection", features });
  });
  field("Changes since", choice([["", "–"], ...pairs.filter(([id]) => id !== String(shown))], "", compare)).append(note);
}
