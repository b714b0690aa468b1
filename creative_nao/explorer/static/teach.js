// Teach in three steps: demonstrations as keys of postures, a memory trained on them, and exploring it.
import { Cells, colourOf, letter } from "./engine.js";
import { PBMap, WHOLE } from "./map.js";
import { Stage } from "./robot.js";
import { base64Blob, download } from "./source.js";
import { draftSvg, fill, lossSvg, make } from "./drawing.js";
import { $, app, controls, pictureOf, source, telling, toast, waiting } from "./page.js";
import { sheet } from "./shows.js";

const KEPT = "creative-nao-keyframes";
const TOLD = "creative-nao-conversions"; // what was converted, by the name of the demonstration
const LONGEST_S = 12;
const PARTS = ["shoulder pitch", "shoulder roll", "elbow yaw", "elbow roll"];
const MIRROR = [1, -1, -1, -1]; // an arm's angles as those of the other, of the same movement in a mirror
const clone = (value) => JSON.parse(JSON.stringify(value));
const spoken = (name) => name.replaceAll("_", " ");

const teaching = { drafts: [], place: 0, key: 0, past: [], checked: null, joints: [], ranges: [], touched: false, fresh: "", told: {}, taught: "", progress: null };
const here = () => teaching.drafts[teaching.place];
const keys = () => here()[1];

export async function teach() {
  document.title = "Teach the robot: memory explorer";
  for (const part of document.querySelectorAll(".explore-only")) part.hidden = true;
  for (const id of ["tour", "race", "shortcuts", "physics", "ghost"]) $(id).hidden = true;
  $("to-teach").setAttribute("aria-current", "page");
  $("to-explore").removeAttribute("aria-current");
  const { drafts, joints, ranges } = await source.ask("keyframes");
  Object.assign(teaching, { drafts, joints, ranges, taught: new URLSearchParams(location.search).get("taught") ?? "" });
  try {
    const kept = JSON.parse(sessionStorage.getItem(KEPT));
    if (Array.isArray(kept) && kept.length) teaching.drafts = kept;
    teaching.told = JSON.parse(sessionStorage.getItem(TOLD)) ?? {};
  } catch { /* what cannot be read is as if it was not there */ }
  const place = make("div", { className: "stage" });
  $("stages").append(place);
  const stage = (teaching.stage = new Stage(place, app.robot, app.player));
  app.panels = [{ stage }];
  app.player.looping = false;
  $("loop").setAttribute("aria-pressed", false);
  lay();
  controls(receive);
  await check();
  pose();
  if (teaching.taught) watch();
}

const STEPS = ["Pose", "Train", "Explore"];
const button = (text, act, more = {}) => {
  const made = make("button", more, text);
  made.addEventListener("click", act);
  return made;
};

function lay() {
  const box = $("teach");
  box.hidden = false;
  const file = make("input", { type: "file", id: "teach-file" });
  file.addEventListener("change", () => {
    if (file.files[0]) receive(file.files[0]);
    file.value = "";
  });
  box.replaceChildren(
    make("nav", { className: "steps", ariaLabel: "Steps" }, STEPS.map((step, k) => button([make("b", {}, `${k + 1}`), ` ${step}`], () =>
      $(`step-${k + 1}`).scrollIntoView({ block: "start" }), { id: `to-step-${k + 1}` }))),
    make("h2", { id: "step-1" }, "1  Pose"),
    make("p", { className: "small" }, "A demonstration is a row of postures. Choose one below, then pull the sliders: the robot follows."),
    make("div", { id: "drafts", className: "row" }),
    make("div", { className: "row" }, [
      button("New", addDraft), button("Mirror image", mirror), button("Remove", removeDraft),
      button("Start with boxing", startBoxing), make("label", { className: "button", id: "import-recording", title: "Angles of the robot, or motion capture of a person; or drop it on the page" }, ["Import a recording", file]), button("Undo", undo, { id: "teach-undo" }),
    ]),
    make("div", { id: "timeline", role: "group", ariaLabel: "Postures over time" }),
    make("div", { className: "row status" }, [make("p", { id: "teach-status", role: "status" }), button("Slow it down", slowDown, { id: "slower", hidden: true })]),
    make("p", { id: "told", className: "small" }),
    make("div", { className: "row" }, [
      make("label", {}, ["Name ", make("input", { id: "draft-name", size: 14 })]), make("label", {}, ["At ", make("input", { id: "key-time", size: 5, inputMode: "decimal" }), " s"]),
      button("Add posture", addKey), button("Remove posture", removeKey), button("Preview", preview), button("In physics", physics),
    ]),
    make("div", { id: "sliders" }),
    make("details", {}, [make("summary", {}, "Curves"), make("div", { className: "curves", id: "draft-curves" })]),
    make("h2", { id: "step-2" }, "2  Train"),
    make("div", { className: "row" }, [
      button("Train", train, { id: "train", className: "primary" }),
      make("label", {}, ["for ", select("epochs", [[10000, "10,000 rounds"], [30000, "30,000 rounds"], [60000, "60,000 rounds"], [100000, "100,000 rounds"]], 30000)]),
      button("Stop", () => control("POST"), { id: "teach-stop", hidden: true }), button("Go on", goOn, { id: "go-on", hidden: true }),
    ]),
    make("p", { id: "train-help", className: "small" }),
    make("details", {}, [make("summary", {}, "More settings"), make("div", { className: "row" }, [
      make("label", {}, ["While it trains, it predicts from ", select("condition", [["auto", "its own prediction, from one start (auto)"], ["open", "what it is shown"], ["half", "half and half"], ["closed", "its own prediction"]], "auto")]),
      make("label", {}, ["Seed ", make("input", { id: "seed", size: 6, value: "0", inputMode: "numeric" })]),
    ])]),
    make("p", { id: "training", role: "status" }),
    make("div", { className: "learning", id: "learning", hidden: true }, [make("div", { className: "map small-map", id: "grown" }, [make("canvas"), layer()]), make("div", { id: "loss" })]),
    make("p", { id: "result" }),
    make("h2", { id: "step-3" }, "3  Explore"),
    make("p", { id: "explore-help", className: "small" }),
    make("div", { className: "row" }, [
      button("Explore this memory", () => location.assign(`./?taught=${teaching.taught}`), { id: "explore", className: "primary", disabled: true }),
      button("Download memory", () => control("GET", "file"), { id: "save", disabled: true }),
      button("Download CSV", async () => {
        const made = await waiting(() => source.send("csv", teaching.drafts));
        if (made) download(made.name, base64Blob(made));
      }),
    ]),
  );
  for (const [id, act] of [["draft-name", rename], ["key-time", retime]]) $(id).addEventListener("change", act);
  $("sliders").replaceChildren(...[["Left arm", 4], ["Right arm", 0]].map(([arm, first]) => make("fieldset", {}, [
    make("legend", {}, arm), ...PARTS.map((part, k) => slider(`${part}`, `${arm} ${part}`, first + k)),
  ])));
}

function layer() {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 100 100");
  svg.innerHTML = '<g></g><g class="ring"></g>';
  return svg;
}

function select(id, pairs, chosen) {
  const made = make("select", { id });
  made.append(...pairs.map(([value, text]) => new Option(text, value, false, value === chosen)));
  return made;
}

function slider(part, label, joint) {
  const [min, max] = teaching.ranges[joint];
  const input = make("input", { type: "range", id: `joint-${joint}`, min, max, step: 0.01, ariaLabel: label });
  input.addEventListener("input", () => {
    remember(`slide ${teaching.place} ${teaching.key} ${joint}`);
    keys()[teaching.key][1 + joint] = Number(input.value);
    figure();
    pose();
    checkSoon();
  });
  const figure = () => (number.textContent = Number(input.value).toFixed(2));
  const number = make("span", { className: "figures" });
  input.figure = figure;
  return make("label", {}, [make("span", {}, part), input, number]);
}

// ---- changes

let merged = "";
function remember(what = "") {
  teaching.fresh = "";
  if (!what || what !== merged) teaching.past = [...teaching.past, clone([teaching.drafts, teaching.place, teaching.key])].slice(-50);
  merged = what;
  teaching.touched = true;
}

function undo() {
  if (!teaching.past.length) return;
  [teaching.drafts, teaching.place, teaching.key] = teaching.past.pop();
  merged = "";
  check().then(pose);
}

function freeName(wish) {
  const taken = teaching.drafts.map(([name]) => name);
  for (let k = 1; ; k++) {
    const name = k === 1 ? wish.slice(0, 24) : `${wish.slice(0, 21)}_${k}`;
    if (!taken.includes(name)) return name;
  }
}

function add(name, rows, told = "", fresh = false) {
  if (teaching.drafts.length >= 8) return void toast("There may be 8 demonstrations; remove one first.");
  remember();
  teaching.drafts.push([freeName(name), rows]);
  const [made] = teaching.drafts.at(-1);
  if (told) teaching.told[made] = told;
  if (fresh) teaching.fresh = made; // nothing is wrong yet with what nobody has posed
  Object.assign(teaching, { place: teaching.drafts.length - 1, key: 0 });
  return check().then(pose);
}

const addDraft = () => {
  const guard = keys()[0].slice(1);
  return add("my_move", [[0, ...guard], [0.75, ...guard], [1.5, ...guard]], "", true);
};

// The whole movement, as slow as its motors need; postures at every tick stay at every tick.
function slowDown() {
  const rows = keys();
  const { dt, slowdowns } = teaching.checked;
  const factor = Math.ceil(100 * slowdowns[teaching.place] + 1) / 100;
  const dense = rows.every((row, k) => !k || row[0] - rows[k - 1][0] <= dt + 1e-6);
  const slow = rows.map(([time, ...posture]) => [Math.ceil(100 * time * factor - 1e-6) / 100, ...posture]);
  if (slow.at(-1)[0] > LONGEST_S) return toast(`It would last ${slow.at(-1)[0].toFixed(1)} s, ${LONGEST_S} are the most: remove postures first.`);
  remember();
  here()[1] = dense ? atTicks(slow, dt) : slow;
  teaching.key = 0;
  return check().then(pose);
}

function atTicks(rows, dt) {
  const n = Math.ceil(rows.at(-1)[0] / dt - 1e-6);
  return Array.from({ length: n + 1 }, (_, tick) => {
    const time = Math.min(tick * dt, rows.at(-1)[0]);
    const next = Math.max(1, rows.findIndex((row) => row[0] >= time - 1e-9));
    const [a, b] = [rows[next - 1], rows[next]];
    const share = (time - a[0]) / (b[0] - a[0]);
    return a.map((value, k) => (k ? value + share * (b[k] - value) : Math.round(100 * tick * dt) / 100));
  });
}

function mirror() {
  const name = here()[0];
  const other = name.includes("left") ? name.replace("left", "right") : name.includes("right") ? name.replace("right", "left") : `${name.slice(0, 17)}_mirror`;
  const turned = (row) => [row[0], ...row.slice(5).map((angle, k) => angle * MIRROR[k]), ...row.slice(1, 5).map((angle, k) => angle * MIRROR[k])];
  return add(other, keys().map(turned));
}

function removeDraft() {
  if (teaching.drafts.length === 1) return toast("One demonstration has to stay.");
  remember();
  teaching.drafts.splice(teaching.place, 1);
  Object.assign(teaching, { place: Math.max(0, teaching.place - 1), key: 0 });
  return check().then(pose);
}

async function startBoxing() {
  remember();
  teaching.drafts = (await source.ask("keyframes")).drafts;
  Object.assign(teaching, { place: 0, key: 0 });
  check().then(pose);
}

function rename() {
  remember();
  const before = here()[0];
  here()[0] = $("draft-name").value.trim().replaceAll(" ", "_");
  if (teaching.told[before]) teaching.told[here()[0]] = teaching.told[before];
  check();
}

function retime() {
  const time = Number($("key-time").value.replace(",", "."));
  if (!Number.isFinite(time)) return show();
  remember();
  const row = keys()[teaching.key];
  row[0] = Math.round(100 * time) / 100;
  keys().sort((a, b) => a[0] - b[0]);
  teaching.key = keys().indexOf(row);
  return check();
}

function addKey() {
  const rows = keys();
  const [time, after] = [rows[teaching.key][0], rows[teaching.key + 1]?.[0]];
  const when = Math.round(100 * (after === undefined ? time + 0.5 : (time + after) / 2)) / 100;
  const movement = teaching.checked?.movements[teaching.place];
  const tick = movement ? Math.min(movement.length - 1, Math.round(when / teaching.checked.dt)) : 0;
  const posture = after === undefined || !movement ? rows[teaching.key].slice(1) : movement[tick];
  remember();
  rows.splice(teaching.key + 1, 0, [when, ...posture]);
  teaching.key += 1;
  return check().then(pose);
}

function removeKey() {
  if (keys().length <= 2) return toast("A demonstration needs two postures or more.");
  remember();
  keys().splice(teaching.key, 1);
  const start = keys()[0][0];
  for (const row of keys()) row[0] = Math.round(100 * (row[0] - start)) / 100;
  teaching.key = Math.min(teaching.key, keys().length - 1);
  return check().then(pose);
}

// Each movement of a recording can become a demonstration, with a posture at every tick.
async function receive(file) {
  const read = await waiting(() => source.read("", file), $("import-recording"));
  if (!read) return;
  const stem = file.name.replace(/\.\w+$/, "").replace(/\W+/g, "_").replace(/^[^A-Za-z]+/, "") || "recording";
  if (read.movements.length === 1) return teachRecorded(file.name, stem, read.movements[0], read.dt);
  const choices = read.movements.map((movement) => {
    const picture = thumbnail(telling(movement.angles));
    const choose = button([...(picture ? [make("img", { src: picture, alt: "" })] : []), movement.name], async () => {
      choose.disabled = true;
      const name = /^(left|right) arm/.test(movement.name) ? movement.name.split(" ")[0] : stem;
      if ((await teachRecorded(file.name, `${name}_${read.movements.indexOf(movement) + 1}`, movement, read.dt)) === null) choose.disabled = false;
    }, { className: "key" });
    return choose;
  });
  sheet(`${file.name}: ${read.movements.length} movements`, [
    make("p", {}, "Choose those to teach; what each is called, you say."), make("div", { className: "found" }, choices),
  ], [], () => {}, "Done");
}

async function teachRecorded(file, name, { angles, notes }, dt) {
  const whole = angles.length;
  const rows = angles.slice(0, Math.round(LONGEST_S / dt) + 1).map((row, tick) => [Math.round(100 * tick * dt) / 100, ...row]);
  const cut = rows.length < whole ? [`the first ${LONGEST_S} s of ${((whole - 1) * dt).toFixed(1)}`] : [];
  const told = [...cut, ...notes].join("; ");
  const adding = add(name, rows, `From ${file}: ${told || "as it was recorded"}.`);
  if (!adding) return null;
  await adding;
  toast(`${file} is a demonstration of ${rows.length} postures now.${told ? ` ${told}.` : ""}`);
  return rows;
}

// ---- what is shown

let checking = 0;
function checkSoon() {
  clearTimeout(checking);
  checking = setTimeout(check, 150);
}

async function check() {
  show();
  try {
    sessionStorage.setItem(KEPT, JSON.stringify(teaching.drafts));
    sessionStorage.setItem(TOLD, JSON.stringify(teaching.told));
    teaching.checked = await source.send("keyframes", teaching.drafts);
    teaching.refused = "";
  } catch (error) {
    teaching.refused = error.message;
  }
  show();
}

function show() {
  const { drafts, place, key, checked } = teaching;
  $("drafts").replaceChildren(...drafts.map(([name], k) => {
    const choose = button(`${letter(k)} ${spoken(name)}`, () => {
      Object.assign(teaching, { place: k, key: 0 });
      show();
      preview();
    });
    choose.setAttribute("aria-pressed", k === place);
    choose.style.borderBottom = `4px solid ${colourOf(k)}`;
    return choose;
  }));
  $("timeline").replaceChildren(...keys().map((row, k) => {
    const picture = thumbnail(row.slice(1));
    const choose = button([...(picture ? [make("img", { src: picture, alt: "" })] : []), `${row[0].toFixed(2)} s`], () => {
      teaching.key = k;
      show();
      pose();
    }, { className: "key", ariaLabel: `Posture at ${row[0].toFixed(2)} s` });
    choose.setAttribute("aria-pressed", k === key);
    return choose;
  }));
  for (const [id, value] of [["draft-name", here()[0]], ["key-time", keys()[key][0].toFixed(2)]]) if (document.activeElement !== $(id)) $(id).value = value;
  for (let joint = 0; joint < 8; joint++) {
    const input = $(`joint-${joint}`);
    if (document.activeElement !== input) input.value = keys()[key][1 + joint];
    input.figure();
  }
  const fresh = teaching.fresh === here()[0];
  const fault = teaching.refused || checked?.faults[place] || checked?.shortcomings[0] || "";
  const advice = checked?.advice?.length && !fault ? ` Advice: ${checked.advice[0]}.` : "";
  const words = fresh && !teaching.refused ? `${spoken(here()[0])} still stands: choose its second posture and pull the sliders.` : fault;
  fill($("teach-status"), {
    textContent: words || `${drafts.length} demonstrations, all fit to be taught.${advice}`, className: fault && teaching.touched && !fresh ? "fault" : "",
  });
  $("slower").hidden = teaching.refused || !(checked?.slowdowns[place] > 1);
  fill($("told"), { textContent: teaching.told[here()[0]] ?? "" });
  $("teach-undo").disabled = !teaching.past.length;
  const busy = ["waiting", "learning"].includes(teaching.progress?.phase);
  $("train").disabled = busy || !!teaching.refused || !!checked?.shortcomings.length;
  fill($("train-help"), { textContent: $("train").disabled && !busy ? `First, in step 1: ${words}` : "" });
  const ready = !!teaching.progress?.map && !busy;
  fill($("explore-help"), { textContent: ready ? "" : busy ? "As soon as it has learned." : "First train it, in step 2." });
  [true, !!teaching.progress, ready].forEach((reached, k) => $(`to-step-${k + 1}`).classList.toggle("reached", reached));
  if (checked?.movements[place]) $("draft-curves").innerHTML = draftSvg(teaching.joints, teaching.ranges, checked.movements[place]);
}

const pictures = new Map();
function thumbnail(posture) {
  const name = posture.map((angle) => angle.toFixed(2)).join();
  if (!pictures.has(name)) {
    if (pictures.size > 400) pictures.clear();
    pictures.set(name, pictureOf(posture));
  }
  return pictures.get(name);
}

function pose() {
  app.player.pause();
  teaching.stage.show({ dt: 1, angles: [keys()[teaching.key].slice(1)] });
  app.player.start();
}

function preview() {
  const angles = teaching.checked?.movements[teaching.place];
  if (!angles) return;
  teaching.stage.show({ dt: teaching.checked.dt, angles });
  app.player.start();
  app.player.play();
}

async function physics() {
  const { checked, place } = teaching;
  if (!checked?.movements[place]) return;
  const clip = await waiting(() => source.perform(checked.dt, checked.movements[place]));
  if (!clip) return;
  app.panels[0].body = clip;
  teaching.stage.show(clip);
  app.player.start();
  app.player.play();
  const hardest = Math.max(0, ...clip.hits.map(([, newton]) => newton));
  const told = clip.failure ? `The body cannot do it: ${spoken(clip.failure)}.` : "The body can do it.";
  $("teach-status").textContent = `In physics: ${told} ${clip.hits.length ? `It hits the bag with ${hardest.toFixed(0)} N.` : "The bag is not hit."}`;
}

// ---- training

async function train() {
  const seed = Number($("seed").value);
  const asked = { drafts: teaching.drafts, condition: $("condition").value, epochs: Number($("epochs").value), seed: Number.isInteger(seed) && seed >= 0 ? seed : 0 };
  const begun = await waiting(() => source.send("train", asked), $("train"));
  if (!begun) return;
  teaching.taught = begun.taught;
  history.replaceState(null, "", `teach?taught=${begun.taught}`);
  watch();
}

async function goOn() {
  if (await waiting(() => source.send("train", { drafts: teaching.drafts, epochs: Number($("epochs").value), taught: teaching.taught }))) watch();
}

async function control(method, what = "") {
  const made = await waiting(() => source.ask(`taught/${teaching.taught}`, { method, query: what ? { [what]: 1 } : {} }));
  if (made?.content) download(made.name, base64Blob(made));
}

let watching = 0;
async function watch() {
  const mine = ++watching;
  while (mine === watching) {
    try {
      teaching.progress = await source.ask(`taught/${teaching.taught}`, { query: { map: 1 } });
    } catch (error) {
      toast(error.message);
      return;
    }
    await trained(teaching.progress);
    const busy = ["waiting", "learning"].includes(teaching.progress.phase);
    await new Promise((done) => setTimeout(done, busy ? 600 : 10_000));
  }
}

let grown = null;
let drawn = "";
async function trained({ phase, text, curve, epochs, map, names, distances, threshold }) {
  const busy = ["waiting", "learning"].includes(phase);
  fill($("training"), { textContent: text });
  $("loss").innerHTML = lossSvg(curve, epochs);
  $("learning").hidden = false;
  $("teach-stop").hidden = !busy;
  $("go-on").hidden = busy || phase === "failed";
  for (const id of ["explore", "save"]) $(id).disabled = busy || !map;
  $("train").disabled ||= busy;
  if (map && map.outcome + map.similarity !== drawn) {
    drawn = map.outcome + map.similarity;
    grown ??= new PBMap($("grown"), { pb: [] }, { press() {}, drag() {}, release() {}, hover() {}, hold() {}, zoom() {} });
    grown.memory = { pb: map.pb };
    grown.show(await Cells.from(map), null, "nearest", WHOLE);
  }
  show();
  if (!distances) return;
  const back = distances.filter((distance) => distance <= threshold).length;
  $("result").textContent = `${back} of ${distances.length} demonstrations come back as they were shown${back < distances.length
    ? `; not yet: ${names.filter((_, k) => distances[k] > threshold).join(", ")}. ${$("condition").value === "auto" ? "Go on training, try another seed, or make them more different" : "Train with auto, or go on training"}` : ""}.`;
}
