// Exact models: their objects, their measures, and exact sections.

import { element, fill, latest, paragraph, table, text, working } from "./interface.js";
import { Scene, distinct } from "./scene.js";

/** Objects that the table of measures lists. */
const MOST_ROWS = 200;

export async function showModel({ dataset, place, assetUrl }) {
  const three = await import(assetUrl("vendor/three.js"));
  const objects = await dataset.triangles({}, { progress: working });
  const [min, max] = dataset.header.bounds;
  const origin = new three.Vector3(...min).add(new three.Vector3(...max)).multiplyScalar(0.5);
  const view = new Scene(three, [min, max].map((corner) => new three.Vector3(...corner).sub(origin).toArray()));
  objects.forEach(({ name, positions, indices, origin: own }, number) => {
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
    geometry.setIndex(new three.BufferAttribute(indices, 1));
    const material = new three.MeshStandardMaterial({ color: distinct(three, number), flatShading: true, roughness: 0.9, side: three.DoubleSide, clippingPlanes: [view.plane] });
    const mesh = new three.Mesh(geometry, material);
    mesh.position.set(...own).sub(origin);
    mesh.name = name ?? "";
    view.body.add(mesh);
  });
  view.lookFrom(place.view);
  view.draw();

  const outlines = new three.Group();
  view.scene.add(outlines);
  const cut = latest(async (signal, axis, at) => {
    outlines.clear();
    element("answer").hidden = axis === undefined;
    if (axis === undefined) return view.draw();
    const number = ["x", "y", "z"].indexOf(axis);
    const world = at + origin.getComponent(number);
    const { polygons, area } = await dataset.section({ axis, at: world }, { signal, progress: working });
    const [u, v] = [0, 1, 2].filter((other) => other !== number);
    for (const { rings } of polygons) {
      const flat = rings.map((ring) => ring.map((corner) => new three.Vector2(corner[u] - origin.getComponent(u), corner[v] - origin.getComponent(v))));
      const shape = new three.Shape(flat[0]);
      shape.holes = flat.slice(1).map((ring) => new three.Path(ring));
      const geometry = new three.ShapeGeometry(shape);
      const places = geometry.getAttribute("position");
      for (let index = 0; index < places.count; index++) {
        const corner = new three.Vector3().setComponent(u, places.getX(index)).setComponent(v, places.getY(index)).setComponent(number, at);
        places.setXYZ(index, ...corner.toArray());
      }
      outlines.add(new three.Mesh(geometry, new three.MeshBasicMaterial({ color: 0xd9572b, side: three.DoubleSide, polygonOffset: true, polygonOffsetFactor: -1 })));
    }
    fill("answer", `Section across ${axis}`, table([], [["at", text(world)], ["area", text(area)], ["polygons", text(polygons.length)]]));
    view.draw();
  });
  view.addSection(cut);

  const measures = await dataset.measures({}, { progress: working });
  const rows = [["volume", text(measures.volume)], ["area", text(measures.area)], ["centroid", measures.centroid.map(text).join(", ")]];
  const parts = [table([], rows)];
  if (measures.objects?.length > 1) {
    parts.push(table(["object", "volume", "area"], measures.objects.slice(0, MOST_ROWS).map(({ name, volume, area }) => [name, text(volume), text(area)])));
    if (measures.objects.length > MOST_ROWS) parts.push(paragraph(`${text(measures.objects.length - MOST_ROWS)} more`, "faint"));
  }
  fill("tools", "Measures", ...parts);
  view.onClick = (hit) => {
    if (!hit) return (element("answer").hidden = true);
    const object = measures.objects?.find(({ name }) => name === hit.object.name);
    const place = hit.point.clone().add(origin);
    fill("answer", hit.object.name || "Object", table([], [["at", place.toArray().map(text).join(", ")], ...(object ? [["volume", text(object.volume)]] : [])]));
  };
  return view;
}
