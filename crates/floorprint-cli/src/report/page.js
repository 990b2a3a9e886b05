"use strict";
// Plans can be moved and enlarged, and say which pose is under the pointer. Without this script they are pictures.
const poses = JSON.parse(document.getElementById("poses").textContent);
for (const plan of document.querySelectorAll(".plan")) {
  const svg = plan.querySelector("svg");
  const fit = svg.getAttribute("viewBox").split(" ").map(Number);
  const all = (plan.dataset.all || "").split(" ").map(Number);
  const bar = plan.querySelector(".scale"), readout = plan.querySelector("output"), dot = plan.querySelector(".here");
  let box = fit.slice();
  const show = (next) => {
    box = next;
    svg.setAttribute("viewBox", box.join(" "));
    const px = svg.getScreenCTM().a, most = svg.clientWidth / 4 / px;
    const power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((factor) => factor * power <= most) * power;
    bar.firstElementChild.style.width = `${length * px}px`;
    bar.lastElementChild.textContent = length < 1 ? `${Math.round(length * 100)} cm` : `${length} m`;
  };
  const world = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const zoom = (factor, x = box[0] + box[2] / 2, y = box[1] + box[3] / 2) => {
    const width = Math.min(Math.max(box[2] * factor, 0.5), 20 * Math.max(fit[2], all[2] || 0));
    const share = width / box[2];
    show([x - (x - box[0]) * share, y - (y - box[1]) * share, width, box[3] * share]);
  };
  const move = (dx, dy) => show([box[0] + dx, box[1] + dy, box[2], box[3]]);
  const actions = {
    in: () => zoom(1 / 1.5),
    out: () => zoom(1.5),
    fit: () => show(fit.slice()),
    all: () => show(all.slice()),
  };
  plan.querySelectorAll("button").forEach((button) => button.addEventListener("click", actions[button.name]));
  const keys = { "+": actions.in, "-": actions.out, 0: actions.fit };
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  svg.addEventListener("keydown", (event) => {
    const arrow = arrows[event.key];
    if (arrow) move((arrow[0] * box[2]) / 8, (arrow[1] * box[3]) / 8);
    else if (keys[event.key]) keys[event.key]();
    else return;
    event.preventDefault();
  });
  // A wheel alone scrolls the page.
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    const at = world(event);
    zoom(Math.exp(event.deltaY * 0.003), at.x, at.y);
  }, { passive: false });
  svg.addEventListener("dblclick", (event) => {
    const at = world(event);
    zoom(0.5, at.x, at.y);
  });
  const held = new Map();
  svg.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, world(event));
    svg.setPointerCapture(event.pointerId);
  });
  const release = (event) => held.delete(event.pointerId);
  svg.addEventListener("pointerup", release);
  svg.addEventListener("pointercancel", release);
  svg.addEventListener("pointermove", (event) => {
    const at = world(event), from = held.get(event.pointerId);
    if (from && held.size === 1) move(from.x - at.x, from.y - at.y);
    if (from && held.size === 2) {
      const [other] = [...held].filter(([id]) => id !== event.pointerId).map(([, point]) => point);
      const apart = Math.hypot(at.x - other.x, at.y - other.y);
      if (apart > 0) zoom(Math.hypot(from.x - other.x, from.y - other.y) / apart, other.x, other.y);
    }
    if (held.size) return;
    let nearest = null, least = (box[2] / 25) ** 2;
    for (const pose of poses) {
      const squared = (pose[1] - at.x) ** 2 + (-pose[2] - at.y) ** 2;
      if (squared < least) [nearest, least] = [pose, squared];
    }
    // What is rounded to zero has no sign.
    const fixed = (number, digits) => number.toFixed(digits).replace(/^-(?=[0.]*$)/, "");
    const pointer = `x ${fixed(at.x, 2)} m, y ${fixed(-at.y, 2)} m`;
    readout.textContent = nearest
      ? `${nearest[0].toFixed(1)} s (stamp ${nearest[4]}): x ${fixed(nearest[1], 2)} m, y ${fixed(nearest[2], 2)} m, heading ${fixed(nearest[3], 1)}°`
      : pointer;
    dot.setAttribute("visibility", nearest ? "visible" : "hidden");
    if (nearest) dot.setAttribute("d", `M${nearest[1]} ${-nearest[2]}h0`);
  });
  svg.addEventListener("pointerleave", () => {
    readout.textContent = "";
    dot.setAttribute("visibility", "hidden");
  });
  addEventListener("resize", () => show(box));
  show(box);
  plan.classList.add("live");
}
