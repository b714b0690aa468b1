// The robot as a three.js object, and one player for everything on the page that moves with it.
import { THREE } from "nicegui-scene";

const upright = (geometry) => geometry.rotateX(Math.PI / 2); // MuJoCo's capsules lie along z, those here along y
const SHAPES = {
  sphere: (s) => new THREE.SphereGeometry(s[0], 16, 12),
  capsule: (s) => upright(new THREE.CapsuleGeometry(s[0], 2 * s[1], 5, 14)),
  cylinder: (s) => upright(new THREE.CylinderGeometry(s[0], s[0], 2 * s[1], 18)),
  ellipsoid: (s) => new THREE.SphereGeometry(1, 16, 12).scale(s[0], s[1], s[2]),
  box: (s) => new THREE.BoxGeometry(2 * s[0], 2 * s[1], 2 * s[2]),
};

// One time for all robots, curves and controls of the page. Controls carry data-player="play|loop|speed|scrub|clock".
class Player {
  constructor() {
    this.robots = new Set();
    this.time = 0;
    this.duration = 0;
    this.speed = 1;
    this.looping = true;
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.before = performance.now();
    const control = (event) => event.target.closest?.("[data-player]");
    document.addEventListener("click", (event) => {
      const action = control(event)?.dataset.player;
      if (action === "play") this.toggle();
      if (action === "loop") this.looping = !this.looping;
      if (action === "speed") this.speed = { 1: 0.5, 0.5: 0.25, 0.25: 1 }[this.speed];
    });
    document.addEventListener("input", (event) => {
      if (control(event)?.dataset.player !== "scrub") return;
      this.playing = false;
      this.seek((event.target.value / 1000) * this.duration);
    });
    document.addEventListener("keydown", (event) => {
      const typing = /^(INPUT|TEXTAREA|SELECT|BUTTON)$/.test(event.target.tagName);
      if (event.key !== " " || typing) return;
      event.preventDefault();
      this.toggle();
    });
    const frame = (now) => {
      if (this.playing && this.duration) this.seek(this.next((now - this.before) / 1000));
      this.before = now;
      this.show();
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }
  next(elapsed) {
    const time = this.time + Math.max(0, elapsed) * this.speed;
    if (time <= this.duration) return time;
    if (this.looping) return time % this.duration;
    this.playing = false;
    return this.duration;
  }
  toggle() {
    if (!this.playing && this.time >= this.duration) this.time = 0;
    this.playing = !this.playing;
  }
  restart() {
    this.duration = Math.max(0, ...[...this.robots].map((robot) => robot.duration));
    this.seek(0);
  }
  seek(time) {
    this.time = time;
    for (const robot of this.robots) {
      if (robot.mounted && !robot.root.parent) this.robots.delete(robot);
      else robot.pose(time);
    }
  }
  show() {
    const share = this.duration ? this.time / this.duration : 0;
    document.documentElement.style.setProperty("--robot-t", share);
    for (const element of document.querySelectorAll("[data-player]")) {
      const kind = element.dataset.player;
      if (kind === "scrub" && document.activeElement !== element) element.value = Math.round(1000 * share);
      if (kind === "scrub" && document.activeElement === element && this.playing) element.value = Math.round(1000 * share);
      const text = {
        clock: `${this.time.toFixed(2)} of ${this.duration.toFixed(2)} s`,
        play: this.playing ? "Pause" : "Play",
        loop: this.looping ? "Loop: on" : "Loop: off",
        speed: `Speed: ${this.speed}`,
      }[kind];
      const label = element.querySelector(".block") ?? element;
      if (text && label.textContent !== text) label.textContent = text;
    }
  }
}

export const player = (window.robotPlayer ??= new Player());

export default class Robot {
  create_mesh(description) {
    this.root = new THREE.Group();
    this.nodes = { world: this.root };
    this.hinges = description.hinges.map((hinge) => ({ ...hinge, axis: new THREE.Vector3(...hinge.axis) }));
    this.ghostly = [];
    for (const body of description.bodies) {
      const node = body.name === "world" ? this.root : new THREE.Group();
      this.nodes[body.name] = node;
      node.name = body.name;
      node.position.fromArray(body.pos);
      node.quaternion.fromArray(body.quat);
      node.userData.rest = { place: node.position.clone(), turn: node.quaternion.clone() };
      for (const shape of body.shapes) node.add(this.mesh(shape));
      if (node !== this.root) this.nodes[body.parent].add(node);
    }
    for (const side of ["R", "L"]) this.addGhost(description, `nao/${side}Shoulder`);
    player.robots.add(this);
    if (this.waiting) this.perform(...this.waiting);
    return this.root;
  }
  mesh(shape, ghost = false) {
    const look = { color: new THREE.Color(shape.colour).multiplyScalar(0.6), opacity: shape.opacity, transparent: shape.opacity < 1 };
    const material = ghost
      ? new THREE.MeshBasicMaterial({ color: "#7a4fd0", transparent: true, opacity: 0.22, depthWrite: false })
      : new THREE.MeshPhongMaterial(look);
    const mesh = new THREE.Mesh(SHAPES[shape.kind](shape.size), material);
    mesh.position.fromArray(shape.pos);
    mesh.quaternion.fromArray(shape.quat);
    return mesh;
  }
  addGhost(description, shoulder) {
    // A second, see-through arm on the same trunk: the nearest basic action.
    const arm = { [shoulder]: null };
    for (const body of description.bodies) {
      if (body.name !== shoulder && !(body.parent in arm)) continue;
      const node = new THREE.Group();
      node.name = `ghost:${body.name}`;
      node.position.fromArray(body.pos);
      node.quaternion.fromArray(body.quat);
      node.userData.rest = { place: node.position.clone(), turn: node.quaternion.clone() };
      for (const shape of body.shapes) node.add(this.mesh(shape, true));
      (arm[body.parent] ?? this.nodes[body.parent]).add(node);
      arm[body.name] = node;
      this.nodes[node.name] = node;
      if (body.name === shoulder) this.ghostly.push(node);
    }
  }
  // movement: {dt, angles} of an imagined movement or {dt, n, tracks} of a physical one; ghost: {dt, angles} or null
  perform(movement, ghost = null) {
    if (!this.root) return void (this.waiting = [movement, ghost]);
    this.movement = movement;
    this.ghost = ghost;
    this.duration = ((movement.angles?.length ?? movement.n) - 1) * movement.dt;
    for (const node of Object.values(this.nodes)) {
      if (!node.userData.rest) continue;
      node.position.copy(node.userData.rest.place);
      node.quaternion.copy(node.userData.rest.turn);
    }
    for (const node of this.ghostly) node.visible = !!ghost;
    player.restart();
    performance.mark("robot-perform");
  }
  pose(time) {
    if (!this.movement) return;
    this.mounted ||= !!this.root.parent;
    if (this.movement.tracks) this.poseTracks(time);
    else this.poseArms(this.movement, time, "");
    if (this.ghost) this.poseArms(this.ghost, time, "ghost:");
  }
  poseArms({ dt, angles }, time, prefix) {
    const exact = Math.min(time / dt, angles.length - 1);
    const tick = Math.min(Math.floor(exact), Math.max(0, angles.length - 2));
    const share = exact - tick;
    const after = angles[Math.min(tick + 1, angles.length - 1)];
    this.hinges.forEach(({ body, axis }, joint) => {
      const node = this.nodes[prefix + body];
      const angle = angles[tick][joint] * (1 - share) + after[joint] * share;
      node.quaternion.setFromAxisAngle(axis, angle).premultiply(node.userData.rest.turn);
    });
  }
  poseTracks(time) {
    const { dt, n, tracks } = this.movement;
    const exact = Math.min(time / dt, n - 1);
    const tick = Math.min(Math.floor(exact), Math.max(0, n - 2));
    const next = Math.min(tick + 1, n - 1);
    const [place, turn] = [new THREE.Vector3(), new THREE.Quaternion()];
    for (const { body, places, turns } of tracks) {
      const node = this.nodes[body];
      node.position.fromArray(places, 3 * tick).lerp(place.fromArray(places, 3 * next), exact - tick);
      node.quaternion.fromArray(turns, 4 * tick).slerp(turn.fromArray(turns, 4 * next), exact - tick);
    }
  }
}
