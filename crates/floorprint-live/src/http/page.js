"use strict";
// World: x right, y up, metres. Screen: CSS pixels from the top left.

const element = (id) => document.getElementById(id);
const canvas = element("map");
const pen = canvas.getContext("2d");
const SIDE = 256, LEVELS = 6;

const view = { x: 0, y: 0, scale: 30, follow: true, fitted: false };
const map = { resolution: 0, origin: [0, 0], revision: new Map(), pictures: new Map() };
let picture = { trajectory: [], closures: [] };
let situation = null;
let trail = [];
let heardAt = 0, isConnected = false;
let placing = null;

// ---------- theme ----------
const root = document.documentElement;
const wantsDark = matchMedia("(prefers-color-scheme: dark)");
let colors = {};
function setTheme(dark) {
  root.dataset.theme = dark ? "dark" : "light";
  element("theme").textContent = dark ? "Light" : "Dark";
  const style = getComputedStyle(root);
  for (const name of ["ground", "text", "robot", "scan", "trajectory", "closure", "mode", "grid", "bad", "good"]) {
    colors[name] = style.getPropertyValue("--" + name).trim();
  }
  map.pictures.clear();
  redraw();
}
function stored(key, value) {
  try {
    if (value === undefined) return localStorage.getItem(key);
    localStorage.setItem(key, value);
  } catch { /* without a memory the page works as well */ }
  return null;
}

// ---------- geometry ----------
const toScreen = (x, y) => [canvas.clientWidth / 2 + (x - view.x) * view.scale, canvas.clientHeight / 2 - (y - view.y) * view.scale];
const toWorld = (x, y) => [view.x + (x - canvas.clientWidth / 2) / view.scale, view.y - (y - canvas.clientHeight / 2) / view.scale];

function bounds() {
  let box = null;
  const widen = (x, y) => {
    box ??= [x, y, x, y];
    box = [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y)];
  };
  const size = SIDE * map.resolution;
  for (const key of map.revision.keys()) {
    const [column, row] = key.split(",").map(Number);
    widen(map.origin[0] + column * size, map.origin[1] + row * size);
    widen(map.origin[0] + (column + 1) * size, map.origin[1] + (row + 1) * size);
  }
  return box;
}
function fit() {
  const box = bounds();
  if (!box) return;
  const narrow = canvas.clientWidth <= 640;
  const right = narrow ? 0 : 320, top = narrow ? 120 : 64, bottom = narrow ? 70 : 16;
  const width = Math.max(canvas.clientWidth - right - 32, 100), height = Math.max(canvas.clientHeight - top - bottom, 100);
  view.scale = Math.min(width / Math.max(box[2] - box[0], 1), height / Math.max(box[3] - box[1], 1));
  view.x = (box[0] + box[2]) / 2 + right / 2 / view.scale;
  view.y = (box[1] + box[3]) / 2 + (top - bottom) / 2 / view.scale;
  setFollow(false);
  redraw();
}
function zoom(factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
  const [before_x, before_y] = toWorld(x, y);
  view.scale = Math.min(Math.max(view.scale * factor, 0.5), 2000);
  const [after_x, after_y] = toWorld(x, y);
  view.x += before_x - after_x;
  view.y += before_y - after_y;
  redraw();
}
function setFollow(follow) {
  view.follow = follow;
  element("follow").setAttribute("aria-pressed", follow);
}

// ---------- tiles ----------
function level() {
  const pixelsPerCell = view.scale * map.resolution * devicePixelRatio;
  return Math.min(Math.max(Math.floor(-Math.log2(Math.max(pixelsPerCell, 1e-6))), 0), LEVELS - 1);
}
function revisionAt(level, column, row) {
  if (level === 0) return map.revision.get(column + "," + row) ?? 0;
  return map.coarse?.[level]?.get(column + "," + row) ?? 0;
}
// The newest revision of each tile of the coarser levels.
function makeCoarse() {
  map.coarse = [map.revision];
  for (let level = 1; level < LEVELS; level++) {
    const coarse = new Map();
    for (const [key, revision] of map.coarse[level - 1]) {
      const [column, row] = key.split(",").map((number) => Math.floor(number / 2));
      const at = column + "," + row;
      coarse.set(at, Math.max(coarse.get(at) ?? 0, revision));
    }
    map.coarse.push(coarse);
  }
}
function tile(level, column, row) {
  const revision = revisionAt(level, column, row);
  if (!revision) return null;
  const key = level + "/" + column + "/" + row;
  let entry = map.pictures.get(key);
  if (!entry) map.pictures.set(key, (entry = { shown: null, wanted: 0 }));
  if (entry.wanted !== revision) {
    entry.wanted = revision;
    const image = new Image();
    image.onload = () => { entry.shown = image; redraw(); };
    // Asked again when it is next drawn.
    image.onerror = () => { setTimeout(() => { if (entry.wanted === revision) entry.wanted = 0; redraw(); }, 1000); };
    image.src = "tiles/" + key + "?v=" + revision + (root.dataset.theme === "dark" ? "&dark" : "");
  }
  entry.used = performance.now();
  return entry.shown;
}
function forgetTiles() {
  if (map.pictures.size < 600) return;
  const old = performance.now() - 10000;
  for (const [key, entry] of map.pictures) if (entry.used < old) map.pictures.delete(key);
}
function drawTiles() {
  if (!map.resolution) return;
  const at = level(), size = SIDE * map.resolution * 2 ** at;
  const [left, top] = toWorld(0, 0), [right, bottom] = toWorld(canvas.clientWidth, canvas.clientHeight);
  const column = (x) => Math.floor((x - map.origin[0]) / size), row = (y) => Math.floor((y - map.origin[1]) / size);
  pen.imageSmoothingEnabled = view.scale * map.resolution < 1;
  for (let c = column(left); c <= column(right); c++) {
    for (let r = row(bottom); r <= row(top); r++) {
      const image = tile(at, c, r);
      if (!image) continue;
      const [x, y] = toScreen(map.origin[0] + c * size, map.origin[1] + (r + 1) * size);
      const [x2, y2] = toScreen(map.origin[0] + (c + 1) * size, map.origin[1] + r * size);
      // Whole pixels, so that no seams show.
      pen.drawImage(image, Math.round(x), Math.round(y), Math.round(x2) - Math.round(x), Math.round(y2) - Math.round(y));
    }
  }
  forgetTiles();
}

// ---------- drawing ----------
function path(points) {
  pen.beginPath();
  for (let i = 0; i + 1 < points.length; i += 2) pen.lineTo(...toScreen(points[i] / 100, points[i + 1] / 100));
}
function arrow(pose, color, alpha = 1, size = 11) {
  const [x, y] = toScreen(pose[0], pose[1]);
  pen.save();
  pen.translate(x, y);
  pen.rotate(-pose[2]);
  pen.globalAlpha = alpha;
  pen.beginPath();
  pen.moveTo(size * 1.2, 0); pen.lineTo(-size * 0.8, size * 0.8); pen.lineTo(-size * 0.4, 0); pen.lineTo(-size * 0.8, -size * 0.8);
  pen.closePath();
  pen.fillStyle = color;
  pen.fill();
  pen.lineWidth = 1.5;
  pen.strokeStyle = colors.ground;
  pen.stroke();
  pen.restore();
}
function niceLength() {
  const wanted = 110 / view.scale, power = 10 ** Math.floor(Math.log10(wanted));
  return [5, 2, 1].map((n) => n * power).find((length) => length <= wanted) ?? power;
}
function drawGrid() {
  const step = niceLength(), [left, top] = toWorld(0, 0), [right, bottom] = toWorld(canvas.clientWidth, canvas.clientHeight);
  pen.beginPath();
  for (let x = Math.ceil(left / step) * step; x <= right; x += step) { pen.moveTo(...toScreen(x, top)); pen.lineTo(...toScreen(x, bottom)); }
  for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) { pen.moveTo(...toScreen(left, y)); pen.lineTo(...toScreen(right, y)); }
  pen.strokeStyle = colors.grid;
  pen.globalAlpha = 0.35;
  pen.lineWidth = 1;
  pen.stroke();
  pen.globalAlpha = 1;
}
function drawScan(pose, scan) {
  const [sin, cos] = [Math.sin(pose[2]), Math.cos(pose[2])];
  pen.fillStyle = colors.scan;
  for (let i = 0; i + 1 < scan.length; i += 2) {
    const [px, py] = [scan[i] / 100, scan[i + 1] / 100];
    const [x, y] = toScreen(pose[0] + cos * px - sin * py, pose[1] + sin * px + cos * py);
    pen.fillRect(x - 1.25, y - 1.25, 2.5, 2.5);
  }
}
function draw() {
  const ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pose = situation?.pose;
  if (view.follow && pose) [view.x, view.y] = pose;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.fillStyle = colors.ground;
  pen.fillRect(0, 0, width, height);
  drawTiles();
  if (element("show-grid").checked) drawGrid();
  pen.lineJoin = "round";
  drawOverlay();
  if (element("show-trajectory").checked) {
    path(picture.trajectory.concat(trail));
    pen.strokeStyle = colors.trajectory;
    pen.lineWidth = 1.75;
    pen.stroke();
  }
  if (element("show-closures").checked) {
    pen.strokeStyle = colors.closure;
    pen.lineWidth = 1.25;
    for (const line of picture.closures) { path(line); pen.stroke(); }
  }
  if (situation) {
    for (const mode of situation.modes ?? []) arrow(mode, colors.mode, 0.2 + 0.7 * mode[3], 8);
    if (pose) {
      if (element("show-scan").checked && situation.scan) drawScan(pose, situation.scan);
      const sigma = Math.min(situation.sigma?.[0] ?? 0, 50);
      if (sigma * view.scale > 4) {
        const [x, y] = toScreen(pose[0], pose[1]);
        pen.beginPath();
        pen.ellipse(x, y, 2 * sigma * view.scale, 2 * sigma * view.scale, 0, 0, 2 * Math.PI);
        pen.globalAlpha = 0.08;
        pen.fillStyle = colors.robot;
        pen.fill();
        pen.globalAlpha = 0.6;
        pen.setLineDash([6, 5]);
        pen.lineWidth = 1.25;
        pen.strokeStyle = colors.robot;
        pen.stroke();
        pen.setLineDash([]);
        pen.globalAlpha = 1;
      }
      arrow(pose, situation.isLost ? colors.bad : colors.robot);
    }
  }
  if (placing?.at) arrow([...placing.at, placing.theta], colors.mode, 1, 14);
  const length = niceLength();
  element("scale").querySelector("span").style.width = length * view.scale + "px";
  element("scale").querySelector("b").textContent = length >= 1000 ? length / 1000 + " km" : length >= 1 ? length + " m" : Math.round(length * 100) + " cm";
}
let isDue = false;
function redraw() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => { isDue = false; draw(); });
}

// ---------- what is told ----------
function tellState() {
  const state = element("state");
  const set = (text, kind) => { state.textContent = text; state.className = "state " + kind; };
  const mode = situation?.mode ?? picture.mode;
  if (!isConnected) set("not connected", "bad");
  else if (mode === "viewing") set("finished session", "good");
  else if (!situation?.stamp) set("no scan yet", "warn");
  else if (situation.paused) set("paused", "warn");
  else if (performance.now() - heardAt > 3000) set("no scans", "warn");
  else if (situation.isLost) set(mode === "localization" ? "looking for the robot" : "lost", "bad");
  else set(mode === "localization" ? "localised" : "mapping", "good");
}
const text = (id, value) => { element(id).textContent = value; };
function takeSituation(next) {
  const before = situation;
  situation = next;
  if (next.stamp !== before?.stamp) heardAt = performance.now();
  const { pose, sigma } = next;
  text("position", pose ? `${pose[0].toFixed(2)} m, ${pose[1].toFixed(2)} m` : "not known");
  text("heading", pose ? `${((pose[2] * 180) / Math.PI).toFixed(1)}°` : "–");
  text("sigma", sigma && pose ? `±${sigma[0].toFixed(3)} m, ±${((sigma[1] * 180) / Math.PI).toFixed(2)}°` : "–");
  if (next.fits !== undefined) {
    element("fits").value = next.fits;
    text("fits-text", `${Math.round(100 * next.fits)} %`);
  }
  text("hypotheses", next.hypotheses ?? "–");
  text("delay", next.stamp ? `${next.delay.toFixed(1)} ms` : "–");
  text("scans", next.scans ?? "–");
  const lost = next.lost ?? {};
  const losses = [lost.scans && `${lost.scans} scans`, lost.readings && `${lost.readings} readings`].filter(Boolean);
  text("lost", losses.join(", ") || "nothing");
  element("set-pose").hidden = element("relocalise").hidden = next.mode !== "localization";
  element("pause").hidden = next.mode === "viewing";
  element("pause").setAttribute("aria-pressed", next.paused);
  element("pause").textContent = next.paused ? "Go on" : "Pause";
  if (pose) {
    trail.push(Math.round(100 * pose[0]), Math.round(100 * pose[1]));
    if (trail.length > 20000) trail.splice(0, 2000);
  } else if (next.mode === "localization") trail = [];
  tellState();
  redraw();
}
function takePicture(next) {
  picture = next;
  if (next.resolution !== map.resolution) { map.revision.clear(); map.pictures.clear(); }
  map.resolution = next.resolution;
  map.origin = next.origin;
  for (const [column, row, revision] of next.tiles) map.revision.set(column + "," + row, revision);
  makeCoarse();
  if (next.mode !== "localization") trail = [];
  text("name", next.name);
  document.title = next.name + " · Floorprint";
  text("closures", next.mode === "localization" ? "–" : next.closures.length);
  root.classList.toggle("viewing", next.mode === "viewing");
  if (next.mode === "viewing") for (const id of ["follow", "pause", "set-pose", "relocalise"]) element(id).hidden = true;
  if (!view.fitted && map.revision.size) {
    view.fitted = true;
    if (next.mode !== "mapping") fit();
  }
  tellState();
  redraw();
}
function connect() {
  const events = new EventSource("events");
  events.onopen = () => { isConnected = true; map.revision.clear(); map.pictures.clear(); tellState(); };
  events.onerror = () => {
    isConnected = false;
    tellState();
    // A refusal ends it for good: it is tried again.
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, 3000);
  };
  events.addEventListener("situation", (event) => takeSituation(JSON.parse(event.data)));
  events.addEventListener("overlay", (event) => takeOverlay(JSON.parse(event.data)));
  events.addEventListener("picture", (event) => takePicture(JSON.parse(event.data)));
}
async function command(path, body) {
  const answer = await fetch(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) }).catch(() => null);
  if (answer?.ok) return;
  hint("That did not work: " + (answer ? (await answer.text()).trim() || answer.status : "no connection"), 6000);
}
let hintTimer = 0;
function hint(message, milliseconds) {
  clearTimeout(hintTimer);
  element("hint").hidden = !message;
  text("hint-text", message);
  if (milliseconds) hintTimer = setTimeout(() => hint(""), milliseconds);
}

// ---------- hands ----------
const pointers = new Map();
let pinch = 0, pressed = null;
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
  // Two fingers press nothing.
  pressed = pointers.size === 1 ? [event.clientX, event.clientY] : null;
  if (placing) {
    placing.at = toWorld(event.clientX, event.clientY);
    redraw();
  } else canvas.classList.add("moving");
});
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const here = [event.clientX, event.clientY];
  if (placing?.at) {
    const [x, y] = toWorld(...here);
    if (Math.hypot(x - placing.at[0], y - placing.at[1]) * view.scale > 8) placing.theta = Math.atan2(y - placing.at[1], x - placing.at[0]);
    redraw();
  } else if (pointers.size === 2) {
    pointers.set(event.pointerId, here);
    const [[ax, ay], [bx, by]] = [...pointers.values()];
    const apart = Math.hypot(ax - bx, ay - by);
    if (pinch) zoom(apart / pinch, (ax + bx) / 2, (ay + by) / 2);
    view.x -= (here[0] - before[0]) / 2 / view.scale;
    view.y += (here[1] - before[1]) / 2 / view.scale;
    setFollow(false);
    pinch = apart;
  } else {
    view.x -= (here[0] - before[0]) / view.scale;
    view.y += (here[1] - before[1]) / view.scale;
    if (Math.hypot(here[0] - before[0], here[1] - before[1]) > 1) setFollow(false);
    redraw();
  }
  pointers.set(event.pointerId, here);
});
function release(event) {
  pointers.delete(event.pointerId);
  pinch = 0;
  canvas.classList.remove("moving");
  const isPress = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5;
  if (drawing && isPress && event.type === "pointerup") press(event.clientX, event.clientY);
  if (placing?.at && event.type === "pointerup") {
    command("pose", { x: placing.at[0], y: placing.at[1], theta: placing.theta });
    setPlacing(false);
  }
}
canvas.addEventListener("pointerup", release);
canvas.addEventListener("pointercancel", release);
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.clientX, event.clientY);
}, { passive: false });
canvas.addEventListener("keydown", (event) => {
  const step = 60 / view.scale;
  const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
  if (moves[event.key]) {
    view.x += moves[event.key][0];
    view.y += moves[event.key][1];
    setFollow(false);
    redraw();
  } else if (event.key === "+" || event.key === "=") zoom(1.3);
  else if (event.key === "-") zoom(1 / 1.3);
  else if (event.key === "0") fit();
  else if (event.key === "f") { setFollow(!view.follow); redraw(); }
  else if (event.key === "Escape") setPlacing(false);
  else return;
  event.preventDefault();
});
function setPlacing(isPlacing) {
  placing = isPlacing ? { at: null, theta: 0 } : null;
  element("set-pose").setAttribute("aria-pressed", isPlacing);
  canvas.classList.toggle("placing", isPlacing);
  hint(isPlacing ? "Press where the robot is and drag where it looks." : "");
  redraw();
}
element("follow").onclick = () => { setFollow(!view.follow); redraw(); };
element("fit").onclick = fit;
element("zoom-in").onclick = () => zoom(1.5);
element("zoom-out").onclick = () => zoom(1 / 1.5);
element("set-pose").onclick = () => { setTool(null); setPlacing(!placing); };
element("relocalise").onclick = () => command("relocalise", {});
element("pause").onclick = () => command("pause", { paused: !situation?.paused });
element("theme").onclick = () => { const dark = root.dataset.theme !== "dark"; stored("floorprint-theme", dark ? "dark" : "light"); setTheme(dark); };
element("fold").onclick = () => { const fold = element("fold"); fold.setAttribute("aria-expanded", fold.getAttribute("aria-expanded") !== "true"); };
for (const box of document.querySelectorAll("input")) box.onchange = redraw;
wantsDark.addEventListener("change", () => { if (!stored("floorprint-theme")) setTheme(wantsDark.matches); });
addEventListener("resize", redraw);
