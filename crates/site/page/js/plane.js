// Planes that a map is drawn in: web mercator, and a file's own grid mapped to the world's square.
//
// MapLibre only knows longitudes and latitudes. A file's own grid is mapped to the world's square,
// so that tiles, zooms and gestures are the same; these functions convert points of the screen to
// the file's coordinates.

/**
 * Fractions of the world's square, from the north-western corner, of a longitude and a latitude.
 */
function fractions({ lng, lat }) {
  const sine = Math.sin((lat * Math.PI) / 180);
  return [lng / 360 + 0.5, 0.5 - Math.log((1 + sine) / (1 - sine)) / (4 * Math.PI)];
}

function degrees([x, y]) {
  return [(x - 0.5) * 360, (Math.atan(Math.sinh(Math.PI * (1 - 2 * y))) * 180) / Math.PI];
}

/** The plane of web mercator: positions are longitudes and latitudes. */
export const mercator = {
  grid: "web-mercator",
  crs: "lonlat",
  placeOf: ({ lng, lat }) => [((((lng + 180) % 360) + 360) % 360) - 180, lat],
  degreesOf: (place) => place,
  degreesOfWorld: (dataset, positions) => dataset.geographic(positions),
  text: ([longitude, latitude]) => `${latitude.toFixed(5)}°, ${longitude.toFixed(5)}°`,
};

/**
 * The plane of a file's own grid: positions are in the file's system, or in cells if it has none.
 */
export function nativePlane({ transform, depth }) {
  const side = 2 ** depth;
  const [a, b, c, d, e, f] = transform;
  const determinant = a * e - b * d;
  const degreesOf = ([east, north]) => {
    const [u, v] = [east - c, north - f];
    return degrees([(e * u - b * v) / determinant / side, (a * v - d * u) / determinant / side]);
  };
  return {
    grid: "native",
    degreesOf,
    crs: "world",
    placeOf(lngLat) {
      const [x, y] = fractions(lngLat).map((fraction) => fraction * side);
      return [a * x + b * y + c, d * x + e * y + f];
    },
    degreesOfWorld: async (_, positions) => positions.map(degreesOf),
    text: (place) => place.map((number) => Number(number.toPrecision(9))).join(", "),
  };
}

/** Pixels along a side of a tile. */
export const TILE = 256;

/**
 * The tiles of a file's own grid: the deepest zoom, and the raster's bounds as degrees of its
 * plane.
 */
export function nativeTiles({ size, depth }) {
  const side = 2 ** depth;
  const [west, north] = degrees([0, 0]);
  const [east, south] = degrees(size.map((cells) => cells / side));
  return { maxZoom: Math.max(depth - Math.log2(TILE), 0), bounds: [west, south, east, north] };
}

/**
 * The tiles of web mercator: the deepest zoom has about the file's own cell size; `null` if its
 * geographic bounds are unknown.
 */
export function mercatorTiles({ size, geographicBounds }) {
  if (!geographicBounds) return null;
  const [west, south, east, north] = geographicBounds;
  const columns = (size[0] * 360) / Math.max(east - west, 1e-9);
  const maxZoom = Math.min(Math.max(Math.ceil(Math.log2(columns / TILE)), 0), 22);
  return { maxZoom, bounds: [west, Math.max(south, -85), east, Math.min(north, 85)] };
}
