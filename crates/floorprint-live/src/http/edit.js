"use strict";
// What lies over the map: names of places, keep-out areas, changes; and the tools that change it.

let overlay = { revision: 0, isEditable: false, places: [], keepOut: [], changes: [] };
// A tool in use and the corners that were pressed, metres.
let drawing = null;
const TOOLS = {
  erase: { corners: 3, does: "Erase", says: "Press the corners of what is to be erased." },
  crop: { corners: 3, does: "Crop", says: "Press the corners of what is to be kept: all else is left out." },
  "keep-out": { corners: 3, does: "Add area", says: "Press the corners of an area that robots are not to enter." },
  place: { corners: 1, does: "Add place", says: "Press where the place is, and say what it is called." },
};

// ---------- drawing ----------
function outline(points) {
  points.forEach(([x, y], index) => (index ? pen.lineTo(...toScreen(x, y)) : pen.moveTo(...toScreen(x, y))));
  pen.closePath();
}
function fillArea(outlines, color, alpha) {
  pen.beginPath();
  outlines.forEach(outline);
  pen.fillStyle = pen.strokeStyle = color;
  pen.globalAlpha = alpha;
  pen.fill("evenodd");
  pen.globalAlpha = 1;
  pen.lineWidth = 1.5;
  pen.stroke();
}
function drawOverlay() {
  if (element("show-changes").checked) {
    for (const change of overlay.changes) fillArea(change.outlines, change.isNew ? colors.good : colors.bad, 0.35);
  }
  if (element("show-notes").checked) {
    for (const area of overlay.keepOut) fillArea([area], colors.bad, 0.14);
    pen.font = "600 13px system-ui, sans-serif";
    pen.textBaseline = "middle";
    for (const place of overlay.places) {
      const [x, y] = toScreen(...place.at);
      dot(x, y, 5);
      pen.lineWidth = 4;
      pen.strokeStyle = colors.ground;
      pen.strokeText(place.name, x + 10, y);
      pen.fillStyle = colors.text;
      pen.fillText(place.name, x + 10, y);
    }
  }
  if (!drawing) return;
  if (drawing.points.length > 1) fillArea([drawing.points], colors.mode, 0.2);
  for (const point of drawing.points) dot(...toScreen(...point), 5);
}
function dot(x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fillStyle = colors.mode;
  pen.fill();
  pen.lineWidth = 2;
  pen.strokeStyle = colors.ground;
  pen.stroke();
}

// ---------- what is told ----------
function takeOverlay(next) {
  overlay = next;
  element("edit").hidden = !next.isEditable;
  const has = next.places.length + next.keepOut.length > 0;
  element("notes").hidden = !has;
  element("label-notes").hidden = !has;
  element("label-changes").hidden = !next.changes.length;
  const area = (isNew) => next.changes.reduce((sum, change) => sum + (change.isNew === isNew ? change.area : 0), 0).toFixed(1);
  text("changes-text", `${area(true)} m² new, ${area(false)} m² gone`);
  const things = [
    ...next.places.map((place) => [place.name, { places: next.places.filter((other) => other !== place) }]),
    ...next.keepOut.map((area, number) => [`Keep-out area ${number + 1}`, { keepOut: next.keepOut.filter((other) => other !== area) }]),
  ];
  element("things").replaceChildren(...things.map(([name, without]) => {
    const item = document.createElement("li"), label = document.createElement("span");
    label.textContent = name;
    item.append(label);
    if (next.isEditable) {
      const remove = document.createElement("button");
      remove.textContent = "×";
      remove.setAttribute("aria-label", "Remove " + name);
      remove.onclick = () => saveNotes(without);
      item.append(remove);
    }
    return item;
  }));
  redraw();
}
function saveNotes(changed) {
  const { revision, places, keepOut } = { ...overlay, ...changed };
  return command("annotations", { revision, places, keep_out: keepOut });
}

// ---------- tools ----------
function setTool(tool) {
  drawing = tool ? { tool, points: [] } : null;
  if (tool) setPlacing(false);
  for (const button of element("edit").querySelectorAll("[data-tool]")) {
    button.setAttribute("aria-pressed", button.dataset.tool === tool);
  }
  canvas.classList.toggle("placing", Boolean(tool));
  hint(tool ? TOOLS[tool].says : "");
  element("ask").hidden = !tool;
  element("ask-name").hidden = tool !== "place";
  element("ask-name").value = "";
  if (tool) text("ask-yes", TOOLS[tool].does);
  // On a phone the map would be hidden.
  if (tool && canvas.clientWidth <= 640) element("fold").setAttribute("aria-expanded", "false");
  tellTool();
}
function tellTool() {
  element("ask-yes").disabled = !isDrawn();
  redraw();
}
function isDrawn() {
  if (!drawing || drawing.points.length < TOOLS[drawing.tool].corners) return false;
  return drawing.tool !== "place" || element("ask-name").value.trim() !== "";
}
function press(x, y) {
  const point = toWorld(x, y).map((coordinate) => Math.round(1000 * coordinate) / 1000);
  if (drawing.tool === "place") {
    drawing.points = [point];
    element("ask-name").focus();
  } else drawing.points.push(point);
  tellTool();
}
async function finishTool() {
  if (!isDrawn()) return;
  const { tool, points } = drawing, name = element("ask-name").value.trim();
  setTool(null);
  if (tool === "erase") await command("restrict", { keep: "outside", polygon: points });
  else if (tool === "crop") await command("restrict", { keep: "inside", polygon: points });
  else if (tool === "keep-out") await saveNotes({ keepOut: [...overlay.keepOut, points] });
  else await saveNotes({ places: [...overlay.places, { name, at: points[0] }] });
}
for (const button of element("edit").querySelectorAll("[data-tool]")) {
  button.onclick = () => setTool(drawing?.tool === button.dataset.tool ? null : button.dataset.tool);
}
element("ask-yes").onclick = finishTool;
element("ask-no").onclick = () => setTool(null);
element("ask-name").oninput = tellTool;
addEventListener("keydown", (event) => {
  if (!drawing || (event.target.tagName === "BUTTON" && event.key === "Enter")) return;
  if (event.key === "Enter") finishTool();
  else if (event.key === "Escape") setTool(null);
  else if (event.key === "Backspace" && event.target !== element("ask-name")) { drawing.points.pop(); tellTool(); }
  else return;
  event.preventDefault();
});

// ---------- begin ----------
if (canvas.clientWidth <= 640) element("fold").setAttribute("aria-expanded", "false");
setTheme((stored("floorprint-theme") ?? (wantsDark.matches ? "dark" : "light")) === "dark");
setInterval(tellState, 1000);
connect();
