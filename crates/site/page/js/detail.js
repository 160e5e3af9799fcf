// Exact models with levels of detail: clusters of triangles, as fine as the camera sees them.

import { distinct } from "./scene.js";
import { latest, working } from "./interface.js";

/** Maximum faces of the first images, and of all others. */
const FACES = [16_000, 128_000, 1_500_000];
/** Maximum error of what is seen, in pixels. */
const PIXELS = 1;
/** Number of clusters that are fetched at once. The camera may have moved then. */
const FETCHED = 128;

/** Linear intensities, from 0 to 65535, of the components of colours. */
const LINEAR = Uint16Array.from({ length: 256 }, (_, number) => {
  const share = number / 255;
  return Math.round(65535 * (share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4));
});

export class ModelDetail {
  /** Called with the number of triangles when others are shown. */
  onShow = () => {};
  /** Meshes by the numbers of their clusters: those in the scene, and some that are to be. */
  #meshes = new Map();
  #image = 0;
  #isOutdated = false;
  #running;

  /** `origin` is the position of the scene's origin. */
  constructor(three, dataset, { view, origin, material }) {
    Object.assign(this, { three, dataset, view, origin, material });
    this.group = new three.Group();
    view.body.add(this.group);
    this.job = latest((signal) => this.#work(signal));
  }

  /** Shows what the camera sees, as the first image if there is none. */
  async show(signal) {
    this.#isOutdated = false;
    const { levels } = this.dataset.header;
    const faces = Math.max(FACES[this.#image], Number(levels[0].faces));
    const { clusters } = await this.dataset.cut({ ...this.#camera(), faces, signal, progress: working });
    const isShown = new Set(clusters);
    for (const [number, mesh] of this.#meshes) {
      if (!mesh.parent && !isShown.has(number)) this.#drop(number, mesh);
    }
    const missing = clusters.filter((number) => !this.#meshes.has(number));
    for (let at = 0; at < missing.length; at += FETCHED) {
      if (at > 0 && this.#isOutdated) return;
      await this.#load(missing.slice(at, at + FETCHED), signal);
    }
    // (All at once: the surface is closed.)
    let triangles = 0;
    for (const [number, mesh] of this.#meshes) {
      if (!isShown.has(number)) this.#drop(number, mesh);
      else this.group.add(mesh);
    }
    for (const { userData } of this.#meshes.values()) triangles += userData.objects.length;
    this.onShow(triangles);
    this.view.draw();
    if (this.#image + 1 < FACES.length) {
      this.#image += 1;
      this.#isOutdated = true;
    }
  }

  /** Refines the surface, after the camera or the section has changed. */
  refine() {
    this.#isOutdated = true;
    this.#running ??= this.job().finally(() => (this.#running = undefined));
  }

  async #work(signal) {
    while (this.#isOutdated) await this.show(signal);
  }

  /** The view, in the model's coordinates. */
  #camera() {
    const { three, view, origin } = this;
    const { camera, renderer } = view;
    camera.updateMatrixWorld();
    const { planes } = new three.Frustum().setFromProjectionMatrix(new three.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    return {
      eye: camera.position.clone().add(origin).toArray(),
      tolerance: (PIXELS * 2 * Math.tan((camera.fov * Math.PI) / 360)) / renderer.domElement.height,
      halfSpaces: [...planes, view.plane].map(({ normal, constant }) => [...normal.toArray(), constant - normal.dot(origin)]),
    };
  }

  async #load(clusters, signal) {
    const { three } = this;
    const mesh = await this.dataset.mesh({ clusters, signal, progress: working });
    const at = new three.Vector3(...mesh.origin).sub(this.origin);
    let first = 0;
    for (const { number, end } of mesh.clusters) {
      const { positions, colours, objects } = this.#cornersOf(mesh, first, end);
      const geometry = new three.BufferGeometry();
      geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
      geometry.setAttribute("color", new three.BufferAttribute(colours, 3, true));
      const made = new three.Mesh(geometry, this.material);
      made.position.copy(at);
      made.userData = { objects };
      this.#meshes.set(number, made);
      first = end;
    }
  }

  /** Positions and colours of the corners of triangles. Without colours, each object has one. */
  #cornersOf(mesh, start, end) {
    const objects = mesh.objects.slice(start, end);
    const positions = new Float32Array(9 * objects.length);
    mesh.indices.subarray(3 * start, 3 * end).forEach((vertex, corner) => {
      for (let axis = 0; axis < 3; axis += 1) positions[3 * corner + axis] = mesh.positions[3 * vertex + axis];
    });
    const colours = mesh.colours ? Uint16Array.from(mesh.colours.subarray(9 * start, 9 * end), (part) => LINEAR[part]) : coloursOf(this.three, objects);
    return { positions, colours, objects };
  }

  #drop(number, mesh) {
    this.#meshes.delete(number);
    mesh.removeFromParent();
    mesh.geometry.dispose();
  }
}

/** A colour for each corner, by its object. */
export function coloursOf(three, objects) {
  const colours = new Uint16Array(objects.length * 9);
  const known = new Map();
  objects.forEach((object, triangle) => {
    if (!known.has(object)) known.set(object, distinct(three, object).toArray().map((part) => Math.round(65535 * part)));
    const colour = known.get(object);
    for (let at = 0; at < 9; at += 3) colours.set(colour, triangle * 9 + at);
  });
  return colours;
}
