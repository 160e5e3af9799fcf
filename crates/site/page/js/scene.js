// A three.js scene: camera, light, controls, a section plane, and picking.

import { choice, element, field, slider } from "./interface.js";
import { colour } from "./ground.js";
import { changeSettings } from "./settings.js";

/** Field of view, in degrees, along the shorter side of the area that the panel does not cover. */
const ANGLE = 45;
/**
 * Distance of the camera from the centre of a box, in diagonals of the box: the box fits into a
 * little less than that angle.
 */
const DISTANCE = 1.33;

export class Scene {
  /** Called before a frame is drawn if the camera has moved. */
  onMove = () => {};
  /** Called with the first hit of a ray from the click, or `undefined`. */
  onClick = () => {};

  /** A scene for the contents of a box, given by its minimum and maximum. */
  constructor(three, [min, max]) {
    this.three = three;
    const container = element("view");
    this.renderer = new three.WebGLRenderer({ antialias: true });
    this.renderer.localClippingEnabled = true;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("aria-label", "Solid: turn it by dragging or with the arrow keys, zoom with plus and minus");
    container.replaceChildren(canvas);
    this.scene = new three.Scene();
    this.body = new three.Group();
    this.scene.add(this.body);
    this.box = new three.Box3(new three.Vector3(...min), new three.Vector3(...max));
    const size = this.box.getSize(new three.Vector3()).length() || 1;
    this.camera = new three.PerspectiveCamera(ANGLE, 1, size / 5000, size * 20);
    this.camera.up.set(0, 0, 1);
    this.controls = new three.OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.scene.add(new three.HemisphereLight(0xffffff, 0x8a8f98, 1.6));
    const sun = new three.DirectionalLight(0xffffff, 1.8);
    this.camera.add(sun);
    sun.position.set(-0.4, 0.8, 1);
    this.scene.add(this.camera);
    /** Plane of the section. Its negative side is not drawn; initially the plane has no effect. */
    this.plane = new three.Plane(new three.Vector3(0, 0, -1), 1e30);
    const middle = this.box.getCenter(new three.Vector3());
    this.camera.position.copy(middle).addScaledVector(new three.Vector3(0.55, -0.75, 0.5).normalize(), size * DISTANCE);
    this.controls.target.copy(middle);
    this.controls.addEventListener("change", () => {
      this.onMove();
      this.draw();
      const numbers = [...this.camera.position.toArray(), ...this.controls.target.toArray()];
      changeSettings({ view: numbers.map((number) => Number(number.toPrecision(6))).join(",") });
    });
    this.#listen(canvas);
    this.resized = new ResizeObserver(() => this.#resize(container));
    this.resized.observe(container);
    this.resized.observe(element("panel"));
    this.#resize(container);
    this.scheme = matchMedia("(prefers-color-scheme: dark)");
    this.onTheme = () => this.draw();
    this.scheme.addEventListener("change", this.onTheme);
    this.controls.update();
  }

  /** Sets the camera from a link. */
  setCamera(view) {
    const numbers = (view ?? "").split(",").map(Number);
    if (numbers.length !== 6 || !numbers.every(Number.isFinite)) return;
    this.camera.position.set(...numbers.slice(0, 3));
    this.controls.target.set(...numbers.slice(3));
    this.controls.update();
  }

  #listen(canvas) {
    let pressed;
    canvas.addEventListener("pointerdown", ({ clientX, clientY }) => (pressed = [clientX, clientY]));
    canvas.addEventListener("pointerup", (event) => {
      const isClick = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4;
      if (isClick) this.onClick(this.hit(event));
    });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
      const factors = { "+": 0.85, "=": 0.85, "-": 1 / 0.85 };
      const offset = this.camera.position.clone().sub(this.controls.target);
      if (turns[event.key]) {
        const spherical = new this.three.Spherical().setFromVector3(new this.three.Vector3(offset.x, offset.z, -offset.y));
        spherical.theta += turns[event.key][0];
        spherical.phi = Math.min(Math.max(spherical.phi + turns[event.key][1], 0.02), Math.PI - 0.02);
        const turned = new this.three.Vector3().setFromSpherical(spherical);
        offset.set(turned.x, -turned.z, turned.y);
      } else if (factors[event.key]) {
        offset.multiplyScalar(factors[event.key]);
      } else if (event.key === "Enter") {
        return this.onClick(this.hitAt(...this.middle));
      } else return;
      event.preventDefault();
      this.camera.position.copy(this.controls.target).add(offset);
      this.controls.update();
    });
  }

  /** The first object under a pointer that the section does not hide. */
  hit({ clientX, clientY }) {
    const { left, top, width, height } = this.renderer.domElement.getBoundingClientRect();
    return this.hitAt((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
  }

  hitAt(x, y) {
    const ray = new this.three.Raycaster();
    ray.setFromCamera(new this.three.Vector2(x, y), this.camera);
    return ray.intersectObject(this.scene, true).find((hit) => {
      const { point, object } = hit;
      // (A section image is visible only where it has a colour.)
      const isSeen = object.userData.isSeen?.(hit) ?? true;
      return object.isMesh && isSeen && this.plane.distanceToPoint(point) >= -1e-6 * this.camera.far;
    });
  }

  #resize({ clientWidth, clientHeight }) {
    const [width, height] = [Math.max(clientWidth, 1), Math.max(clientHeight, 1)];
    // (The panel covers the left of wide screens, and the bottom of narrow ones.)
    const panel = element("panel").getBoundingClientRect();
    const [left, bottom] = panel.width < width / 2 ? [panel.right, 0] : [0, Math.min(panel.height, height * 0.75)];
    const sizes = [width, height, left, bottom].join();
    if (sizes === this.sizes) return;
    this.sizes = sizes;
    this.renderer.setSize(width, height, false);
    this.renderer.domElement.style.cssText = "width: 100%; height: 100%";
    const shorter = Math.min(width - left, height - bottom);
    const tangent = Math.tan((ANGLE * Math.PI) / 360);
    this.camera.fov = (Math.atan((tangent * height) / shorter) * 360) / Math.PI;
    this.camera.aspect = width / height;
    this.camera.setViewOffset(width, height, -left / 2, bottom / 2, width, height);
    /** Centre of the uncovered area, in the coordinates of `hitAt`. */
    this.middle = [left / width, bottom / height];
    this.camera.updateProjectionMatrix();
    this.onMove();
    this.draw();
  }

  /** Schedules a single frame: nothing is drawn while nothing changes. */
  draw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      this.renderer.setClearColor(colour("--ground"));
      this.renderer.render(this.scene, this.camera);
    });
  }

  /**
   * Adds the controls of a section along an axis, with an initial setting. `onCut(axis, at)` is
   * called with the axis and the coordinate on it; without arguments if there is no section.
   */
  addSection(setting, onCut) {
    const axes = ["x", "y", "z"];
    const [, first = "", share = "0.5"] = /^([xyz]):(0(?:\.\d+)?|1)$/.exec(setting ?? "") ?? [];
    let axis = first;
    const at = slider(0, 1, share, 0.001, () => cut());
    const cut = () => {
      at.disabled = axis === "";
      changeSettings({ section: axis && `${axis}:${at.value}` });
      if (axis === "") {
        this.plane.constant = 1e30;
        onCut();
      } else {
        const number = axes.indexOf(axis);
        const [low, high] = [this.box.min.getComponent(number), this.box.max.getComponent(number)];
        const place = low + (high - low) * Number(at.value);
        // (The side towards the camera is removed.)
        const side = this.camera.position.getComponent(number) < place ? 1 : -1;
        this.plane.normal.set(0, 0, 0).setComponent(number, side);
        this.plane.constant = -side * place;
        onCut(axis, place);
      }
      this.draw();
    };
    field("Section", choice([["", "none"], ...axes.map((name) => [name, `across ${name}`])], axis, (chosen) => {
      axis = chosen;
      cut();
    }));
    field("at", at);
    at.disabled = true;
    if (axis) cut();
  }

  close() {
    cancelAnimationFrame(this.frame);
    this.resized.disconnect();
    this.scheme.removeEventListener("change", this.onTheme);
    this.controls.dispose();
    this.scene.traverse((object) => {
      object.geometry?.dispose();
      object.material?.map?.dispose();
      object.material?.dispose();
    });
    this.renderer.dispose();
    element("view").replaceChildren();
  }
}

/** A colour for each number; consecutive numbers have different colours. */
export function distinct(three, number) {
  return new three.Color().setHSL((number * 0.618034) % 1, 0.45, 0.62);
}
