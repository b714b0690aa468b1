// The explorer without a server: map, network, robot and curves in one file.
import { THREE, OrbitControls } from "nicegui-scene";
import Robot from "cn-robot";
import { Memory } from "cn-network";
import { strip } from "cn-attribution";
import { Colouring } from "cn-colouring";

const data = JSON.parse(document.getElementById("data").textContent);
const memory = (window.memory = new Memory(data.memory));
const byId = (id) => document.getElementById(id);
const map = byId("map");
const colouring = new Colouring(data.colours, byId("cells"), byId("texture"));
const WORDS = {
  learned: "appropriate, like a basic action",
  unlearned: "appropriate, new: nobody taught it",
  fluctuating: "inappropriate, too fast for the motors",
  non_moving: "inappropriate, hardly moves",
};
let points = [[0, 0]];
let drawing = null;
let robot = null;

function stage() {
  const box = byId("stage");
  const renderer = new THREE.WebGLRenderer({ antialias: true });
  const scene = (window.scene_alone = new THREE.Scene());
  scene.background = new THREE.Color("#c9d3de");
  scene.add(new THREE.AmbientLight(0xffffff, 0.7 * Math.PI));
  const sun = new THREE.DirectionalLight(0xffffff, 0.3 * Math.PI);
  sun.position.set(5, -10, 40);
  scene.add(sun);
  const camera = new THREE.PerspectiveCamera(50, 1, 0.02, 50);
  camera.up.set(0, 0, 1);
  camera.position.set(0.62, -0.6, 0.52);
  const controls = new OrbitControls(camera, renderer.domElement);
  controls.target.set(0.08, 0, 0.33);
  controls.update();
  const built = new Robot();
  scene.add(built.create_mesh(data.robot));
  box.append(renderer.domElement);
  const fit = () => {
    renderer.setSize(box.clientWidth, box.clientHeight);
    camera.aspect = box.clientWidth / box.clientHeight;
    camera.updateProjectionMatrix();
  };
  new ResizeObserver(fit).observe(box);
  fit();
  renderer.setAnimationLoop(() => renderer.render(scene, camera));
  return built;
}

function show(wanted) {
  points = wanted.map((pb) => pb.map((value) => Math.min(1, Math.max(-1, value))));
  const recall = (window.recall = memory.recall(points));
  const pb = points[points.length - 1].map((value) => value.toFixed(3)).join(", ");
  const where = points.length > 1 ? `path of ${points.length} points to PB ${pb}` : `PB ${pb}`;
  const letter = String.fromCharCode(65 + recall.nearest);
  byId("status").textContent =
    `${where}; ${WORDS[recall.outcome]}; nearest ${letter} ${memory.names[recall.nearest]}; novelty ${recall.novelty.toFixed(1)}`;
  byId("curves").innerHTML = memory.order.map((joint) => curve(recall, joint)).join("");
  byId("strip").innerHTML = strip(recall.angles, memory);
  robot?.perform({ dt: memory.dt, angles: recall.angles }, { dt: memory.dt, angles: memory.demonstrations[recall.nearest] });
  marks();
  here();
}

function here() {
  byId("here").textContent = colouring.tell(points[points.length - 1]);
}

async function recolour(name) {
  if (!(await colouring.choose(name))) return;
  byId("legend").innerHTML = colouring.shown.legend;
  byId("legend").dataset.of = name;
  here();
}

function curve(recall, joint) {
  const [width, height] = [150, 78];
  const y = (angle) => ((height * (2.2 - angle)) / 4.4).toFixed(1);
  const basic = memory.demonstrations[recall.nearest];
  const last = Math.max(recall.angles.length, basic.length) - 1;
  const line = (rows, kind, first = 0) =>
    `<polyline class="${kind}" points="${rows.map((row, t) => `${(((first + t) * width) / last).toFixed(1)},${y(row[joint])}`).join(" ")}"/>`;
  const fast = recall.speeds.map((row, t) =>
    row[joint] > memory.speedLimit[joint] ? line(recall.angles.slice(t, t + 2), "cn-overspeed", t) : "");
  const limits = memory.limits[joint].map((v) => `<line class="cn-limit" x2="${width}" y1="${y(v)}" y2="${y(v)}"/>`);
  const share = (recall.angles.length - 1) / last;
  return `<svg viewBox="0 0 174 98" role="img" aria-label="${memory.joints[joint]} over time"><g transform="translate(20 16)">
    <text class="cn-name" y="-4">${memory.joints[joint]}</text><rect class="cn-panel" width="${width}" height="${height}"/>
    ${limits.join("")}${line(basic, "cn-basic")}${line(recall.angles, "cn-made")}${fast.join("")}
    <line class="cn-cursor" y2="${height}" style="transform:translateX(calc(var(--robot-t, 0) * ${width * share}px))"/></g></svg>`;
}

const pixel = ([a, b]) => [300 + 300 * a, 300 - 300 * b];

function marks() {
  const letters = memory.pb.map((pb, place) => {
    const [x, y] = pixel(pb);
    return `<text x="${x}" y="${y}" dy="0.35em">${String.fromCharCode(65 + place)}</text>`;
  });
  const line = points.map((pb) => pixel(pb).join(",")).join(" ");
  const [x, y] = pixel(points[points.length - 1]);
  const rings = ["white 6", "black 2.5"].map((look) => {
    const [colour, width] = look.split(" ");
    return `<polyline points="${line}" fill="none" stroke="${colour}" stroke-width="${width}"/>
      <circle cx="${x}" cy="${y}" r="11" fill="none" stroke="${colour}" stroke-width="${width}"/>`;
  });
  byId("marks").innerHTML = letters.join("") + rings.join("");
}

function under(event) {
  const box = map.getBoundingClientRect();
  return [((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2];
}

map.addEventListener("pointerdown", (event) => {
  map.setPointerCapture(event.pointerId);
  if (byId("path").checked) drawing = [under(event)];
  else show([under(event)]);
});
map.addEventListener("pointermove", (event) => {
  if (!(event.buttons & 1)) return;
  if (!drawing) return show([under(event)]);
  if (drawing.length < 200) drawing.push(under(event));
  points = drawing;
  marks();
});
map.addEventListener("pointerup", () => {
  if (drawing) show(drawing);
  drawing = null;
});
map.addEventListener("keydown", (event) => {
  const step = event.shiftKey ? 0.1 : 0.01;
  const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  if (move) show([points[points.length - 1].map((value, k) => value + step * move[k])]);
  else if (memory.pb[event.key - 1]) show([memory.pb[event.key - 1]]);
  else if (event.key === "r") surprise();
  else return;
  event.preventDefault();
});

function surprise() {
  for (let trial = 0; trial < 200; trial++) {
    const pb = [0, 1].map(() => 2 * Math.random() - 1);
    if (memory.recall([pb]).outcome === "unlearned") return show([pb]);
  }
}
byId("surprise").addEventListener("click", surprise);

byId("colour").append(...data.colours.sheets.map(({ name, text }) => new Option(text, name)));
byId("colour").addEventListener("change", (event) => recolour(event.target.value));
recolour(byId("colour").value);

try {
  robot = stage();
} catch (error) {
  byId("stage").textContent = "The robot needs WebGL. Without it, the sentence and the curves still tell all.";
}
show([[0, 0]]);
