// The ground under a map: coastlines and a graticule, which come with the page.

/** Coastlines as lines of degrees: texts of steps, in hundredths of a degree, from point to point. */
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

/** Meridians and parallels, every so many degrees. */
function graticule(step) {
  const lines = [];
  for (let at = -180; at <= 180; at += step) {
    lines.push([[at, -85], [at, 85]]);
    if (Math.abs(at) < 86) lines.push([[-180, at], [180, at]]);
  }
  return lines;
}

const lines = (coordinates) => ({ type: "Feature", properties: {}, geometry: { type: "MultiLineString", coordinates } });

/** Sources and layers of the ground, for the style of a MapLibre map; colours are those of the page. */
export async function ground(assetUrl) {
  const text = await (await fetch(assetUrl("vendor/coastlines.txt"))).text();
  return {
    sources: {
      coast: { type: "geojson", data: lines(coastlines(text)) },
      graticule: { type: "geojson", data: lines(graticule(10)) },
    },
    layers: [
      { id: "graticule", type: "line", source: "graticule", paint: { "line-color": colour("--line"), "line-width": 0.5 } },
      { id: "coast", type: "line", source: "coast", paint: { "line-color": colour("--coast"), "line-width": 0.8 } },
    ],
  };
}

/** A colour of the page as it is now, light or dark. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
