// The background of a map: coastlines and a graticule, which are included in the page.

/**
 * Coastlines as lines in degrees, from strings of point-to-point differences in hundredths of a
 * degree.
 */
function coastlines(text) {
  return text.trim().split("\n").map((line) => {
    let [x, y] = [0, 0];
    const numbers = line.split(" ").map(Number);
    const points = [];
    for (let at = 0; at + 1 < numbers.length; at += 2) {
      x += numbers[at];
      y += numbers[at + 1];
      points.push([x / 100, y / 100]);
    }
    return points;
  });
}

/** Intervals of meridians and parallels, in degrees. */
const STEPS = [30, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001];

/** Meridians and parallels in a box, at an interval that suits its width. */
function graticule([west, south, east, north]) {
  const step = STEPS.find((step) => (east - west) / step >= 4) ?? STEPS.at(-1);
  const between = (low, high) => Array.from({ length: Math.max(Math.floor(high / step) - Math.ceil(low / step) + 1, 0) }, (_, at) => (Math.ceil(low / step) + at) * step);
  const [bottom, top] = [Math.max(south, -85), Math.min(north, 85)];
  return [...between(west, east).map((x) => [[x, bottom], [x, top]]), ...between(bottom, top).map((y) => [[west, y], [east, y]])];
}

const lines = (coordinates) => ({ type: "Feature", properties: {}, geometry: { type: "MultiLineString", coordinates } });

/**
 * Sources and layers of the background, for the style of a MapLibre map; colours are those of the
 * page.
 */
export async function ground(assetUrl) {
  const text = await (await fetch(assetUrl("vendor/coastlines.txt"))).text();
  return {
    sources: {
      coast: { type: "geojson", data: lines(coastlines(text)) },
      graticule: { type: "geojson", data: lines([]) },
    },
    layers: [
      { id: "graticule", type: "line", source: "graticule", paint: { "line-color": colour("--line"), "line-width": 0.5 } },
      { id: "coast", type: "line", source: "coast", paint: { "line-color": colour("--coast"), "line-width": 0.8 } },
    ],
  };
}

/** Draws the meridians and parallels of the map's visible area. */
export function showGraticule(map) {
  const bounds = map.getBounds();
  map.getSource("graticule")?.setData(lines(graticule([bounds.getWest(), bounds.getSouth(), bounds.getEast(), bounds.getNorth()])));
}

/** A colour of the page in the current theme, light or dark. */
export function colour(name) {
  const probe = document.createElement("span");
  probe.style.color = `var(${name})`;
  document.body.append(probe);
  const found = getComputedStyle(probe).color;
  probe.remove();
  return found;
}
