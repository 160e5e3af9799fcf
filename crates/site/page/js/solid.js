// Octrees: surfaces of cells, with finer levels close to the camera, and sections with their
// values.

import { clearResult, fill, latest, table, text, working } from "./interface.js";
import { Scene } from "./scene.js";
import { showLegend } from "./legend.js";

/** Level of the surface of an octant, relative to the octant's own: 2^6 cells along each side. */
const LEVELS_BELOW = 6;
/** An octant is divided if it takes more than this share of the view's height. */
const SHARE = 0.9;
/** Maximum number of octants that are drawn. */
const MAX_OCTANTS = 160;

export async function show({ dataset, place, assetUrl }) {
  const { header } = dataset;
  const three = await import(assetUrl("vendor/three.js"));
  const matrix = new three.Matrix4().set(...header.matrix.flat(), 0, 0, 0, 1);
  const toCells = matrix.clone().invert();
  // (World coordinates are large numbers: the scene's origin is the centre.)
  const origin = new three.Vector3(...header.size).multiplyScalar(0.5).applyMatrix4(matrix);
  const local = new three.Matrix4().makeTranslation(-origin.x, -origin.y, -origin.z).multiply(matrix);
  const corners = new three.Box3(new three.Vector3(), new three.Vector3(...header.size)).applyMatrix4(local);
  const smallest = Math.min(...[0, 1, 2].map((axis) => new three.Vector3().setFromMatrixColumn(matrix, axis).length()));
  const view = new Scene(three, [corners.min.toArray(), corners.max.toArray()]);
  const material = new three.MeshStandardMaterial({
    color: 0xb9a68c,
    flatShading: true,
    roughness: 0.95,
    clippingPlanes: [view.plane],
    side: three.DoubleSide,
  });

  /** An octant of a level, at a corner in units of its own size. */
  class Octant {
    constructor(level, corner) {
      Object.assign(this, { level, corner, mesh: undefined, state: "new", children: undefined });
      const size = 2 ** (header.depth - level);
      this.cells = [...corner.map((at) => at * size), ...corner.map((at, axis) => Math.min((at + 1) * size, header.size[axis]))];
      this.box = new three.Box3(new three.Vector3(...this.cells.slice(0, 3)), new three.Vector3(...this.cells.slice(3))).applyMatrix4(local);
    }

    get drawn() {
      return Math.min(this.level + LEVELS_BELOW, header.depth);
    }

    divide() {
      this.children ??= Array.from({ length: 8 }, (_, at) => new Octant(this.level + 1, this.corner.map((corner, axis) => 2 * corner + ((at >> axis) & 1))))
        .filter(({ cells }) => [0, 1, 2].every((axis) => cells[axis] < header.size[axis]));
      return this.children;
    }

    async load(signal) {
      this.state = "loading";
      try {
        const made = await dataset.mesh({ level: this.drawn, cells: this.cells, signal, progress: working });
        this.mesh = new three.Mesh(geometryOf(made), material);
        this.mesh.position.set(...made.origin).sub(origin);
        this.mesh.visible = false;
        view.body.add(this.mesh);
        this.state = "ready";
      } catch (error) {
        this.state = "new";
        throw error;
      }
    }

    show(isShown) {
      if (this.mesh) this.mesh.visible = isShown;
      if (!isShown) this.children?.forEach((child) => child.show(false));
    }
  }

  function geometryOf({ positions, indices }) {
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
    geometry.setIndex(new three.BufferAttribute(indices, 1));
    geometry.computeBoundingSphere();
    return geometry;
  }

  const root = new Octant(0, [0, 0, 0]);
  const frustum = new three.Frustum();
  /** Octants to be loaded, by descending priority; shows those that are loaded. */
  function choose() {
    view.camera.updateMatrixWorld();
    frustum.setFromProjectionMatrix(new three.Matrix4().multiplyMatrices(view.camera.projectionMatrix, view.camera.matrixWorldInverse));
    const wanted = [];
    let count = 0;
    const visit = (octant) => {
      if (!frustum.intersectsBox(octant.box)) return octant.show(false);
      const size = octant.box.getSize(new three.Vector3()).length();
      const distance = Math.max(octant.box.distanceToPoint(view.camera.position), size / 100);
      const share = size / distance / (2 * Math.tan((view.camera.fov * Math.PI) / 360));
      if (octant.state === "new") wanted.push([share, octant]);
      const isDivided = octant.drawn < header.depth && share > SHARE * 2 && count < MAX_OCTANTS;
      if (isDivided) {
        const children = octant.divide();
        const isReady = children.every(({ state, box }) => state === "ready" || !frustum.intersectsBox(box));
        if (isReady) {
          if (octant.mesh) octant.mesh.visible = false;
          return children.forEach(visit);
        }
        children.filter(({ state, box }) => state === "new" && frustum.intersectsBox(box)).forEach((child) => wanted.push([share / 2, child]));
      }
      octant.children?.forEach((child) => child.show(false));
      octant.show(true);
      count += 1;
    };
    visit(root);
    return wanted.sort(([a], [b]) => b - a).map(([, octant]) => octant);
  }

  const refine = latest(async (signal) => {
    for (let wanted = choose(); wanted.length && !signal.aborted; wanted = choose()) {
      await wanted[0].load(signal);
      view.draw();
    }
    choose();
    view.draw();
  });
  view.onMove = refine;
  view.setCamera(place.view);
  await refine();

  // The section: an image of the values in the plane.
  let quad;
  const cut = latest(async (signal, axis, at) => {
    if (quad) {
      quad.visible = axis !== undefined;
      if (axis === undefined) return view.draw();
    }
    if (axis === undefined) return;
    const number = ["x", "y", "z"].indexOf(axis);
    // (Frames of solids are axis-aligned: the section is at a cell index along the axis.)
    const point = new three.Vector3().copy(origin).setComponent(number, at + origin.getComponent(number)).applyMatrix4(toCells);
    const cell = Math.min(Math.max(Math.floor(point.getComponent(number)), 0), header.size[number] - 1);
    const image = await dataset.slice({ axis, index: cell, size: 512, style: "default", signal, progress: working });
    const { cells } = image;
    const [u, v] = [0, 1, 2].filter((other) => other !== number);
    // (Cells of the image: first ones, and exclusive ends.)
    const corner = (along, up) => {
      const made = new three.Vector3();
      return made.setComponent(number, cell + 0.5).setComponent(u, along).setComponent(v, up).applyMatrix4(local).toArray();
    };
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.Float32BufferAttribute([corner(cells[u], cells[v]), corner(cells[3 + u], cells[v]), corner(cells[3 + u], cells[3 + v]), corner(cells[u], cells[3 + v])].flat(), 3));
    geometry.setAttribute("uv", new three.Float32BufferAttribute([0, 0, 1, 0, 1, 1, 0, 1], 2));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    // (Texture rows ascend. Images across z have the lowest row first, too; others have the highest
    // row first.)
    const pixels = axis === "z" ? new Uint8Array(image.data.buffer) : flipped(image);
    const texture = new three.DataTexture(pixels, image.width, image.height);
    texture.colorSpace = three.SRGBColorSpace;
    texture.needsUpdate = true;
    quad?.geometry.dispose();
    quad?.material.map.dispose();
    quad?.removeFromParent();
    quad = new three.Mesh(geometry, new three.MeshBasicMaterial({ map: texture, transparent: true, alphaTest: 0.02, side: three.DoubleSide }));
    quad.userData.isSeen = ({ uv }) => {
      const [column, row] = [uv.x * image.width, uv.y * image.height].map(Math.floor);
      return pixels[4 * (row * image.width + column) + 3] > 0;
    };
    view.scene.add(quad);
    view.draw();
  });
  view.addSection(place.section, cut);

  const showCell = latest(async (signal, hit) => {
    if (!hit) return clearResult();
    // (The face's cell is on its inner side: move inwards by a quarter of a cell.)
    const step = hit.object === quad ? 0 : -0.25 * smallest;
    const inside = hit.point.clone().addScaledVector(hit.face.normal, step).add(origin).applyMatrix4(toCells);
    const cell = inside.toArray().map((at, axis) => Math.min(Math.max(Math.floor(at), 0), header.size[axis] - 1));
    const world = new three.Vector3(...cell).addScalar(0.5).applyMatrix4(matrix).toArray();
    const found = await dataset.point(world, { crs: "world", signal });
    const rows = [["value", found.values === null ? "none" : found.values.map(text).join(", ")]];
    if (found.className) rows.push(["class", found.className]);
    rows.push(["cell", cell.join(", ")], ["at", world.map(text).join(", ")]);
    fill("result", "Cell", table([], rows));
  });
  view.onClick = showCell;
  showLegend(await dataset.legend({}), new Set());
  return view;
}

/** An image with its last row first, as in textures. */
function flipped({ width, height, data }) {
  const out = new Uint8Array(data.length);
  for (let row = 0; row < height; row++) out.set(data.subarray(row * width * 4, (row + 1) * width * 4), (height - 1 - row) * width * 4);
  return out;
}
