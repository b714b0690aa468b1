// Teach in three steps: demonstrations as keys of postures, a memory trained on them, and exploring it.
import { Cells, colourOf, letter } from "./engine.js";
import { PBMap, WHOLE } from "./map.js";
import { Stage } from "./robot.js";
import { base64Blob, download } from "./source.js";
import { draftSvg, fill, lossSvg, make } from "./drawing.js";
import { $, app, pictureOf, source, toast, waiting } from "./page.js";

const KEPT = "creative-nao-keyframes";
const PARTS = ["shoulder pitch", "shoulder roll", "elbow yaw", "elbow roll"];
const MIRROR = [1, -1, -1, -1]; // an arm's angles as those of the other, of the same movement in a mirror
const clone = (value) => JSON.parse(JSON.stringify(value));
const spoken = (name) => name.replaceAll("_", " ");

const teaching = { drafts: [], place: 0, key: 0, past: [], checked: null, joints: [], ranges: [], touched: false, taught: "", progress: null };
const here = () => teaching.drafts[teaching.place];
const keys = () => here()[1];

export async function teach() {
  app.teaching = true;
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
  } catch { /* what cannot be read is as if it was not there */ }
  const place = make("div", { className: "stage" });
  $("stages").append(place);
  const stage = (teaching.stage = new Stage(place, app.robot, app.player));
  app.panels = [{ stage }];
  app.player.looping = false;
  lay();
  controls();
  app.receive = receive;
  await check();
  pose();
  if (teaching.taught) watch();
}

function controls() {
  const on = (id, act, kind = "click") => $(id).addEventListener(kind, act);
  on("play", () => app.player.toggle());
  on("scrub", () => {
    app.player.pause();
    app.player.seek(($("scrub").value / 1000) * app.player.duration);
  }, "input");
  on("camera", () => teaching.stage.home());
  on("full", () => (document.fullscreenElement ? document.exitFullscreen() : $("scene").requestFullscreen()));
  on("dark", () => document.documentElement.classList.toggle("dark"));
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files[0]) receive(event.dataTransfer.files[0]);
  });
}

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
    make("h2", {}, "1  Pose"),
    make("p", { className: "small" }, "A demonstration is a row of postures. Choose one below, then pull the sliders: the robot follows."),
    make("div", { id: "drafts", className: "row" }),
    make("div", { className: "row" }, [
      button("New", addDraft), button("Mirror image", mirror), button("Remove", removeDraft),
      button("Start with boxing", startBoxing), make("label", { className: "button" }, ["Import a recording", file]), button("Undo", undo, { id: "teach-undo" }),
    ]),
    make("div", { id: "timeline", role: "group", ariaLabel: "Postures over time" }),
    make("div", { className: "row" }, [
      make("label", {}, ["Name ", make("input", { id: "draft-name", size: 14 })]), make("label", {}, ["At ", make("input", { id: "key-time", size: 5, inputMode: "decimal" }), " s"]),
      button("Add posture", addKey), button("Remove posture", removeKey), button("Preview", preview), button("In physics", physics),
    ]),
    make("div", { id: "sliders" }),
    make("p", { id: "teach-status", role: "status" }),
    make("details", {}, [make("summary", {}, "Curves"), make("div", { className: "curves", id: "draft-curves" })]),
    make("h2", {}, "2  Train"),
    make("div", { className: "row" }, [
      button("Train", train, { id: "train", className: "primary" }),
      make("label", {}, ["for ", select("epochs", [[10000, "10,000 rounds"], [30000, "30,000 rounds"], [60000, "60,000 rounds"], [100000, "100,000 rounds"]], 30000)]),
      button("Stop", () => control("POST"), { id: "teach-stop", hidden: true }), button("Go on", goOn, { id: "go-on", hidden: true }),
    ]),
    make("details", {}, [make("summary", {}, "More settings"), make("div", { className: "row" }, [
      make("label", {}, ["While it trains, it predicts from ", select("condition", [["auto", "its own prediction, from one start (auto)"], ["open", "what it is shown"], ["half", "half and half"], ["closed", "its own prediction"]], "auto")]),
      make("label", {}, ["Seed ", make("input", { id: "seed", size: 6, value: "0", inputMode: "numeric" })]),
    ])]),
    make("p", { id: "training", role: "status" }),
    make("div", { className: "learning" }, [make("div", { className: "map small-map", id: "grown" }, [make("canvas"), layer()]), make("div", { id: "loss" })]),
    make("p", { id: "result" }),
    make("h2", {}, "3  Explore"),
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

function add(name, rows) {
  if (teaching.drafts.length >= 8) return toast("There may be 8 demonstrations; remove one first.");
  remember();
  teaching.drafts.push([freeName(name), rows]);
  Object.assign(teaching, { place: teaching.drafts.length - 1, key: 0 });
  return check().then(pose);
}

const addDraft = () => {
  const guard = keys()[0].slice(1);
  return add("my_move", [[0, ...guard], [0.75, ...guard], [1.5, ...guard]]);
};

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
  here()[0] = $("draft-name").value.trim().replaceAll(" ", "_");
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

// A recording becomes a demonstration: as many of its postures as a demonstration may have.
async function receive(file) {
  const read = await waiting(() => source.read("", file));
  if (!read) return;
  const last = read.angles.length - 1;
  const n = Math.min(24, read.angles.length);
  const rows = Array.from({ length: n }, (_, k) => Math.round((k * last) / (n - 1))).map((tick) => [Math.round(100 * tick * read.dt) / 100, ...read.angles[tick]]);
  const name = file.name.replace(/\.\w+$/, "").replace(/\W+/g, "_").replace(/^[^A-Za-z]+/, "") || "recording";
  await add(name, rows);
  toast(`${file.name} is a demonstration of ${n} postures now.${read.notes.length ? ` ${read.notes.join("; ")}.` : ""}`);
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
  const fault = teaching.refused || checked?.faults[place] || checked?.shortcomings[0] || "";
  const advice = checked?.advice?.length && !fault ? ` Advice: ${checked.advice[0]}.` : "";
  fill($("teach-status"), {
    textContent: fault || `${drafts.length} demonstrations, all fit to be taught.${advice}`, className: fault && teaching.touched ? "fault" : "",
  });
  $("teach-undo").disabled = !teaching.past.length;
  const busy = ["waiting", "learning"].includes(teaching.progress?.phase);
  $("train").disabled = busy || !!teaching.refused || !!checked?.shortcomings.length;
  $("train").title = $("train").disabled && !busy ? fault : "";
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
  if (!distances) return;
  const back = distances.filter((distance) => distance <= threshold).length;
  $("result").textContent = `${back} of ${distances.length} demonstrations come back as they were shown${back < distances.length
    ? `; not yet: ${names.filter((_, k) => distances[k] > threshold).join(", ")}. ${$("condition").value === "auto" ? "Go on training, try another seed, or make them more different" : "Train with auto, or go on training"}` : ""}.`;
  show();
}
