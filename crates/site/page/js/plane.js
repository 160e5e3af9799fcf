// Planes that a map is drawn in: web mercator, and a file's own grid as if its square were the world.
//
// MapLibre knows longitudes and latitudes alone. In its own grid a file's square takes the place of the world's square, so that
// tiles, zooms and gestures are the same; these functions say where a point of the screen lies in the file.

/** Fractions of the world's square, from the north-western corner, of a longitude and a latitude. */
function fractions({ lng, lat }) {
  const sine = Math.sin((lat * Math.PI) / 180);
  return [lng / 360 + 0.5, 0.5 - Math.log((1 + sine) / (1 - sine)) / (4 * Math.PI)];
}

function degrees([x, y]) {
  return [(x - 0.5) * 360, (Math.atan(Math.sinh(Math.PI * (1 - 2 * y))) * 180) / Math.PI];
}

/** The plane of web mercator: places are longitudes and latitudes. */
export const mercator = {
  grid: "web-mercator",
  crs: "EPSG:4326",
  placeOf: ({ lng, lat }) => [((((lng + 180) % 360) + 360) % 360) - 180, lat],
  degreesOf: (place) => place,
  degreesOfCells: (dataset, cells) => dataset.geographic(cells),
  text: ([longitude, latitude]) => `${latitude.toFixed(5)}°, ${longitude.toFixed(5)}°`,
};

/** The plane of a file's own grid: places are in the file's system, or cells where it has none. */
export function nativePlane({ transform, levels }) {
  const side = 2 ** levels;
  const [a, b, c, d, e, f] = transform ?? [1, 0, 0, 0, 1, 0];
  const determinant = a * e - b * d;
  return {
    grid: "native",
    crs: "file",
    placeOf(lngLat) {
      const [x, y] = fractions(lngLat).map((fraction) => fraction * side);
      return [a * x + b * y + c, d * x + e * y + f];
    },
    degreesOf([east, north]) {
      const [u, v] = [east - c, north - f];
      return degrees([(e * u - b * v) / determinant / side, (a * v - d * u) / determinant / side]);
    },
    degreesOfCells: async (_, cells) => cells.map((cell) => degrees(cell.map((at) => at / side))),
    text: (place) => place.map((number) => Number(number.toPrecision(9))).join(", "),
  };
}
