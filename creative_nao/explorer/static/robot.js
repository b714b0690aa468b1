// The robot in its ring as three.js draws it, and the player of all that moves. Nothing is drawn when nothing moves.
const T = globalThis.THREE;

const BLEND_S = 0.22; // how long one movement takes to become the next
const REST_S = 60; // after so long without anybody touching the page, a looping robot rests
const SLOW_FRAME_MS = 30; // between frames that play on where the processor draws: half the work, and no one sees it
const HOME = { position: [0.42, -0.98, 0.56], target: [0.13, 0, 0.34] };
const upright = (geometry) => geometry.rotateX(Math.PI / 2); // MuJoCo's capsules lie along z, those here along y
const SHAPES = {
  sphere: (s) => new T.SphereGeometry(s[0], 18, 14),
  capsule: (s) => upright(new T.CapsuleGeometry(s[0], 2 * s[1], 5, 14)),
  cylinder: (s) => upright(new T.CylinderGeometry(s[0], s[0], 2 * s[1], 20)),
  ellipsoid: (s) => new T.SphereGeometry(1, 18, 14).scale(s[0], s[1], s[2]),
  box: (s) => new T.BoxGeometry(2 * s[0], 2 * s[1], 2 * s[2]),
};

// One time for all stages of the page. `changed` is called when it has moved or play has begun or ended.
export class Player {
  constructor(changed = () => {}) {
    Object.assign(this, { changed, stages: [], time: 0, duration: 0, speed: 1, looping: true, before: 0, drawn: 0, asked: false });
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.touched = performance.now();
    for (const kind of ["pointerdown", "pointermove", "keydown"]) {
      addEventListener(kind, () => (this.touched = performance.now()), { passive: true });
    }
    document.addEventListener("visibilitychange", () => this.wake());
  }

  wake() {
    if (this.asked || document.hidden) return;
    this.asked = true;
    this.before ||= performance.now();
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.asked = false;
    if (this.playing && now - this.drawn < SLOW_FRAME_MS - 4 && this.stages.every((stage) => stage.software && !stage.held)) return this.wake();
    const elapsed = Math.min(0.25, Math.max(0, (now - this.before) / 1000));
    this.before = this.drawn = now;
    if (this.playing && now - this.touched > 1000 * REST_S) this.pause();
    if (this.playing && this.duration) this.seek(this.next(elapsed * this.speed));
    let again = this.playing && this.duration > 0;
    for (const stage of this.stages) again = stage.draw(elapsed) || again;
    if (again) this.wake();
    else this.before = 0;
  }

  next(elapsed) {
    const time = this.time + elapsed;
    if (time <= this.duration) return time;
    if (this.looping) return time % this.duration;
    this.playing = false;
    return this.duration;
  }

  // Begin anew, or go on in the movement that has taken the place of the one before.
  start(anew = true) {
    this.duration = Math.max(0, ...this.stages.map((stage) => stage.duration));
    this.seek(anew ? 0 : Math.min(this.time, this.duration));
  }

  play() {
    this.touched = performance.now();
    this.playing = true;
    this.seek(this.time >= this.duration ? 0 : this.time);
  }

  pause() {
    this.playing = false;
    this.changed();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  seek(time) {
    this.time = time;
    for (const stage of this.stages) stage.pose(time);
    this.changed();
    this.wake();
  }
}

export class Stage {
  // A place for a robot in an element; a `plain` one is for pictures, without ring, camera control and shadows.
  constructor(host, description, player, plain = false) {
    Object.assign(this, { host, player, plain, duration: 0, dirty: true, blend: 1, slow: 0, frames: 0, ghostShown: true });
    this.renderer = new T.WebGLRenderer({ antialias: true, alpha: plain, preserveDrawingBuffer: plain });
    const context = this.renderer.getContext();
    const info = context.getExtension("WEBGL_debug_renderer_info");
    this.software = /swiftshader|llvmpipe|software|basic render/i.test(context.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER));
    this.renderer.shadowMap.enabled = !plain;
    this.renderer.shadowMap.type = T.PCFShadowMap;
    this.scene = new T.Scene();
    this.camera = new T.PerspectiveCamera(44, 1, 0.02, 30);
    this.camera.up.set(0, 0, 1);
    this.light();
    this.robot = new Robot(description, plain);
    this.scene.add(this.robot.root);
    this.ratio = Math.min(devicePixelRatio, this.software ? 1 : 2);
    host.append(this.renderer.domElement);
    this.controls = plain ? null : this.control();
    this.home();
    this.watcher = new ResizeObserver(() => this.fit());
    this.watcher.observe(host);
    this.fit();
    player?.stages.push(this);
  }

  light() {
    if (!this.plain) {
      this.scene.background = new T.Color("#1b2130");
      this.scene.fog = new T.Fog("#1b2130", 2.5, 7);
    }
    const key = (this.key = new T.DirectionalLight(0xfff1dc, 1.9)); // where the ring's key light is
    key.position.set(1.2, -1.6, 2.6);
    key.castShadow = !this.plain;
    key.shadow.mapSize.set(1024, 1024);
    Object.assign(key.shadow.camera, { left: -0.8, right: 0.8, top: 0.9, bottom: -0.8, near: 1, far: 6 });
    key.shadow.bias = -0.002;
    key.shadow.normalBias = 0.01;
    const fillLight = new T.DirectionalLight(0xbfd0ff, 0.6);
    fillLight.position.set(-1.5, 1.5, 2);
    this.scene.add(new T.HemisphereLight(0xdfe8ff, 0x5b5148, 1.0), key, fillLight);
  }

  // The camera stays above the floor, near the robot and pointed at the ring.
  control() {
    const controls = new T.OrbitControls(this.camera, this.renderer.domElement);
    Object.assign(controls, { minDistance: 0.3, maxDistance: 2.2, minPolarAngle: 0.15, maxPolarAngle: 1.5 });
    controls.addEventListener("change", () => {
      controls.target.clamp(new T.Vector3(-0.35, -0.45, 0.1), new T.Vector3(0.5, 0.45, 0.7));
      this.camera.position.z = Math.max(this.camera.position.z, 0.06);
      this.refresh();
    });
    controls.addEventListener("start", () => (this.held = true));
    controls.addEventListener("end", () => (this.held = false));
    this.renderer.domElement.addEventListener("dblclick", () => this.home());
    return controls;
  }

  home() {
    const near = this.plain ? 0.86 : 1;
    this.camera.position.set(...HOME.position.map((value, k) => HOME.target[k] + (value - HOME.target[k]) * near));
    this.camera.lookAt(...HOME.target);
    this.controls?.target.set(...HOME.target);
    this.controls?.update();
    this.refresh();
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height);
    this.aim(width, height);
    this.refresh();
  }

  aim(width, height) {
    this.camera.aspect = width / height;
    this.camera.fov = (this.plain ? 34 : 44) * (width < height ? 1.25 : 1);
    this.camera.updateProjectionMatrix();
  }

  refresh() {
    this.dirty = true;
    this.player?.wake();
  }

  remove() {
    this.player.stages = this.player.stages.filter((stage) => stage !== this);
    this.watcher.disconnect();
    this.controls?.dispose();
    this.scene.traverse((part) => [part.geometry, part.material].forEach((held) => held?.dispose()));
    this.renderer.dispose();
    this.renderer.forceContextLoss(); // a browser gives a page a few contexts only
    this.renderer.domElement.remove();
  }

  // movement: {dt, angles} without a body, or {dt, n, tracks, hits} of physics; ghost: {dt, angles} or null
  show(movement, ghost = null, snap = false) {
    const blends = this.movement && !snap;
    this.robot.rest(blends);
    Object.assign(this, { movement, ghost, blend: blends ? 0 : 1 });
    this.duration = ((movement.angles?.length ?? movement.n) - 1) * movement.dt;
    this.robot.haunt(ghost && this.ghostShown);
    this.dirty = true;
    performance.mark("robot-perform");
  }

  setGhost(shown) {
    this.ghostShown = shown;
    this.robot.haunt(shown && this.ghost);
    this.pose(this.player?.time ?? 0);
    this.refresh();
  }

  pose(time) {
    if (!this.movement) return;
    this.robot.pose(this.movement, time, this.blend);
    if (this.ghost) this.robot.poseArms(this.ghost, time, "ghost:");
    this.dirty = true;
  }

  // Draw if anything has changed; true if more is to come.
  draw(elapsed) {
    if (this.blend < 1) {
      this.blend = Math.min(1, this.blend + elapsed / BLEND_S);
      this.pose(this.player.time);
    }
    if (!this.dirty) return false;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    this.frames++;
    this.adapt(elapsed);
    return this.blend < 1;
  }

  // A machine that draws slowly gets fewer pixels, then no shadows, then fewer pixels still.
  adapt(elapsed) {
    this.slow = elapsed > 0.06 ? this.slow + 1 : Math.max(0, this.slow - 1);
    if (this.slow < 8) return;
    this.slow = -30;
    if (this.ratio > 1) this.ratio = 1;
    else if (this.key.castShadow) this.key.castShadow = false;
    else if (this.ratio > 0.7) this.ratio = 0.7;
    else return;
    this.fit();
  }

  // A picture of one posture as a data address.
  picture(angles, width, height) {
    this.renderer.setPixelRatio(1);
    this.renderer.setSize(width, height, false);
    this.aim(width, height);
    this.show({ dt: 1, angles: [angles] }, null, true);
    this.pose(0);
    this.renderer.render(this.scene, this.camera);
    return this.renderer.domElement.toDataURL("image/png");
  }

  // Light the bag up for a moment.
  flash() {
    for (const on of [true, false]) {
      setTimeout(() => {
        this.robot.glow(on);
        this.refresh();
      }, on ? 0 : 180);
    }
  }
}

class Robot {
  constructor(description, plain) {
    this.root = new T.Group();
    this.nodes = { world: this.root };
    Object.assign(this, { bag: [], ghostly: [], posed: new Set() });
    this.hinges = description.hinges.map((hinge) => ({ ...hinge, axis: new T.Vector3(...hinge.axis) }));
    for (const body of description.bodies) {
      const node = this.node(body, body.name, body.name === "world" ? this.root : new T.Group());
      if (node !== this.root) this.nodes[body.parent].add(node);
      if (!plain || node !== this.root) for (const shape of body.shapes) node.add(this.mesh(shape, body.name));
      if (plain && body.name.startsWith("bag")) node.visible = false;
    }
    if (!plain) {
      const hall = new T.Mesh(new T.CircleGeometry(8, 48), new T.MeshPhongMaterial({ color: "#2a2f3c", shininess: 10 }));
      hall.position.z = -0.15;
      this.root.add(hall);
    }
    for (const side of ["R", "L"]) this.addGhost(description, `nao/${side}Shoulder`);
    this.haunt(false);
  }

  node(body, name, node = new T.Group()) {
    node.name = name;
    node.position.fromArray(body.pos);
    node.quaternion.fromArray(body.quat);
    node.userData = { place: node.position.clone(), turn: node.quaternion.clone(), from: null };
    return (this.nodes[name] = node);
  }

  mesh(shape, body, ghost = false) {
    const look = { color: shape.colour, shininess: 28, specular: 0x222222, opacity: shape.opacity, transparent: shape.opacity < 1 };
    const material = ghost
      ? new T.MeshBasicMaterial({ color: "#b58cff", transparent: true, opacity: 0.25, depthWrite: false })
      : new T.MeshPhongMaterial(look);
    const mesh = new T.Mesh(SHAPES[shape.kind](shape.size), material);
    mesh.position.fromArray(shape.pos);
    mesh.quaternion.fromArray(shape.quat);
    mesh.castShadow = !ghost && body !== "world";
    mesh.receiveShadow = !ghost;
    if (body.startsWith("bag")) this.bag.push(mesh);
    return mesh;
  }

  // A see-through copy of an arm: it shows the nearest taught movement.
  addGhost(description, shoulder) {
    const arm = {};
    for (const body of description.bodies) {
      if (body.name !== shoulder && !arm[body.parent]) continue;
      const node = (arm[body.name] = this.node(body, `ghost:${body.name}`));
      for (const shape of body.shapes) node.add(this.mesh(shape, body.name, true));
      (arm[body.parent] ?? this.nodes[body.parent]).add(node);
      if (body.name === shoulder) this.ghostly.push(node);
    }
  }

  haunt(shown) {
    for (const node of this.ghostly) node.visible = !!shown;
  }

  glow(on) {
    for (const mesh of this.bag) mesh.material.emissive.set(on ? "#c85a00" : "#000000");
  }

  // Stand as the description says; remember the pose as it was if the next movement is blended in.
  rest(blends) {
    for (const node of Object.values(this.nodes)) {
      const own = node.userData;
      own.from = blends ? { place: node.position.clone(), turn: node.quaternion.clone() } : null;
      node.position.copy(own.place);
      node.quaternion.copy(own.turn);
    }
  }

  pose(movement, time, blend) {
    this.posed.clear();
    if (movement.tracks) this.poseTracks(movement, time);
    else this.poseArms(movement, time, "");
    if (blend >= 1) return;
    const share = blend * blend * (3 - 2 * blend);
    for (const [name, node] of Object.entries(this.nodes)) {
      const { from, place, turn } = node.userData;
      if (!from || name.startsWith("ghost:")) continue;
      if (!this.posed.has(node)) {
        node.position.copy(place);
        node.quaternion.copy(turn);
      }
      node.position.lerpVectors(from.place, node.position, share);
      node.quaternion.slerpQuaternions(from.turn, node.quaternion.clone(), share);
    }
  }

  poseArms({ dt, angles }, time, prefix) {
    const exact = Math.min(time / dt, angles.length - 1);
    const tick = Math.min(Math.floor(exact), Math.max(0, angles.length - 2));
    const share = exact - tick;
    const after = angles[Math.min(tick + 1, angles.length - 1)];
    this.hinges.forEach(({ body, axis }, joint) => {
      const node = this.nodes[prefix + body];
      const angle = angles[tick][joint] * (1 - share) + after[joint] * share;
      node.quaternion.setFromAxisAngle(axis, angle).premultiply(node.userData.turn);
      node.position.copy(node.userData.place);
      if (!prefix) this.posed.add(node);
    });
  }

  poseTracks({ dt, n, tracks }, time) {
    const exact = Math.min(time / dt, n - 1);
    const tick = Math.min(Math.floor(exact), Math.max(0, n - 2));
    const next = Math.min(tick + 1, n - 1);
    const [place, turn] = [new T.Vector3(), new T.Quaternion()];
    for (const { body, places, turns } of tracks) {
      const node = this.nodes[body];
      node.position.fromArray(places, 3 * tick).lerp(place.fromArray(places, 3 * next), exact - tick);
      node.quaternion.fromArray(turns, 4 * tick).slerp(turn.fromArray(turns, 4 * next), exact - tick);
      this.posed.add(node);
    }
  }
}
