// Exact models: their objects, their measures, and exact sections.

import { clearResult, fill, latest, measured, table, text, working } from "./interface.js";
import { ModelDetail, coloursOf } from "./detail.js";
import { Scene } from "./scene.js";

export async function show({ dataset, place, assetUrl }) {
  const three = await import(assetUrl("vendor/three.js"));
  const { bounds, unit, levels, objects: names } = dataset.header;
  const origin = new three.Vector3(...bounds.slice(0, 3)).add(new three.Vector3(...bounds.slice(3))).multiplyScalar(0.5);
  const view = new Scene(three, [0, 3].map((at) => new three.Vector3(...bounds.slice(at, at + 3)).sub(origin).toArray()));
  const material = new three.MeshStandardMaterial({ vertexColors: true, flatShading: true, roughness: 0.9, side: three.DoubleSide, clippingPlanes: [view.plane] });
  view.setCamera(place.view);
  const shown = document.createElement("span");
  /** Shows measures, and what is known without them. */
  const showMeasures = (rows = []) => {
    const counts = [["faces", text(dataset.header.faces)], ["objects", text(names.length)]];
    fill("tools", "Measures", table([], [...rows, ...counts, ...(detail ? [["shown", shown]] : [])]));
  };
  const detail = levels.length > 1 ? new ModelDetail(three, dataset, { view, origin, material }) : undefined;
  if (detail) {
    detail.onShow = (triangles) => (shown.textContent = `${text(triangles)} triangles`);
    showMeasures();
    await detail.show();
    view.onMove = () => detail.refine();
  } else {
    view.body.add(await wholeOf(three, dataset, origin, material));
    view.draw();
  }

  const outlines = new three.Group();
  view.scene.add(outlines);
  const cut = latest(async (signal, axis, at) => {
    outlines.clear();
    detail?.refine();
    if (axis === undefined) {
      clearResult();
      return view.draw();
    }
    const number = ["x", "y", "z"].indexOf(axis);
    const world = at + origin.getComponent(number);
    const { features, area } = await dataset.section({ axis, at: world, signal, progress: working });
    const [u, v] = [0, 1, 2].filter((other) => other !== number);
    for (const { geometry: { coordinates } } of features) {
      const flat = coordinates.map((ring) => ring.map((corner) => new three.Vector2(corner[u] - origin.getComponent(u), corner[v] - origin.getComponent(v))));
      const shape = new three.Shape(flat[0]);
      shape.holes = flat.slice(1).map((ring) => new three.Path(ring));
      const geometry = new three.ShapeGeometry(shape);
      const vertices = geometry.getAttribute("position");
      for (let index = 0; index < vertices.count; index++) {
        const corner = new three.Vector3().setComponent(u, vertices.getX(index)).setComponent(v, vertices.getY(index)).setComponent(number, at);
        vertices.setXYZ(index, ...corner.toArray());
      }
      outlines.add(new three.Mesh(geometry, new three.MeshBasicMaterial({ color: 0xd9572b, side: three.DoubleSide, polygonOffset: true, polygonOffsetFactor: -1 })));
    }
    fill("result", `Section across ${axis}`, table([], [["at", measured(world, unit)], ["area", measured(area, unit, "²")], ["polygons", text(features.length)]]));
    view.draw();
  });
  view.addSection(place.section, cut);

  view.onClick = (hit) => {
    if (!hit) return clearResult();
    const name = names[hit.object.userData.objects?.[hit.faceIndex]];
    const place = hit.point.clone().add(origin);
    fill("result", name || "Surface", table([], [["at", place.toArray().map(text).join(", ")]]));
  };
  detail?.refine();
  const measures = await dataset.measures({ progress: working });
  showMeasures([
    ["volume", measured(measures.volume, unit, "³")],
    ["surface", measured(measures.surface, unit, "²")],
    ["centre", measures.centre?.map(text).join(", ") ?? text(null)],
  ]);
  return view;
}

/** The exact surface, for models without levels of detail. */
async function wholeOf(three, dataset, origin, material) {
  const { positions, objects, origin: own } = await dataset.triangles({ progress: working });
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
  geometry.setAttribute("color", new three.BufferAttribute(coloursOf(three, objects), 3, true));
  const body = new three.Mesh(geometry, material);
  body.position.set(...own).sub(origin);
  body.userData = { objects };
  return body;
}
