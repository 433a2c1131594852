// The parts of the page that are drawn from data. Text from outside goes in as text, never as markup.

export function make(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value != null) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child != null));
  return node;
}

function draw(tag, attributes, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

export const variantTag = (variant) => make("span", { class: variant === "unpatched" ? "tag" : "tag on" }, variant);

const percent = (share) => `${Math.round(share * 100)} %`;
const round = (value) => (Math.abs(value) >= 100 ? Math.round(value) : Number(value.toPrecision(3))).toString();

// Where the camera stands: from above with FRONT below, and from the side.
export function drawPlace(place, lens) {
  const turn = place.azimuth_deg <= 180 ? place.azimuth_deg : place.azimuth_deg - 360;
  const side = turn > 0 ? "right" : "left";
  const round = Math.abs(turn) < 0.5 ? "to FRONT" : Math.abs(turn) > 179.5 ? "behind it" : `${Math.abs(turn).toFixed(0)}° ${side}`;
  const facts = [
    ["walk", round], ["look down", `${place.tilt_deg.toFixed(0)}°`], ["distance", `${place.distance_cm.toFixed(0)} cm`],
    ["height", `${place.height_cm.toFixed(0)} cm`],
  ];
  if (Math.abs(place.roll_deg) >= 1) facts.push(["tilted", `${place.roll_deg.toFixed(0)}°`]);
  facts.push(["zoom", `${lens.zoom}×`]);
  const title = `as you walk round the object from its front, and look at it; the zoom is a phone's, for ${lens.focal_mm} mm (35 mm equivalent)`;
  const list = make("dl", { title }, ...facts.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
  return [drawAbove(place), drawSide(place), list];
}

function drawCamera(x, y, degrees) {
  return draw("path", { class: "lens", d: "M-7-6H3V6H-7ZM3-2.5 8-5V5L3 2.5Z", transform: `translate(${x} ${y}) rotate(${degrees})` });
}

function drawAbove(place) {
  const angle = (place.azimuth_deg * Math.PI) / 180;
  const x = 52 + 37 * Math.sin(angle), y = 48 + 37 * Math.cos(angle);
  return draw("svg", { viewBox: "0 0 104 104", role: "img", "aria-label": `camera from above: ${place.azimuth_deg} degrees` },
    draw("circle", { class: "line", cx: 52, cy: 48, r: 37 }),
    draw("path", { class: "body", d: "M43 32h18v26l-9 8-9-8Z" }),
    Object.assign(draw("text", { class: "soft", x: 52, y: 102 }), { textContent: "FRONT" }),
    draw("line", { class: "sight", x1: x, y1: y, x2: 52, y2: 48 }),
    ...drawWay(place.azimuth_deg),
    drawCamera(x, y, 90 - place.azimuth_deg + 180));
}

// The way to walk there from the front, the shorter way round, with a head at its end.
function drawWay(azimuth) {
  const turn = azimuth <= 180 ? azimuth : azimuth - 360, end = (turn * Math.PI) / 180, r = 46;
  if (Math.abs(turn) < 15) return [];
  const stop = end - Math.sign(turn) * 0.22, at = (angle) => `${(52 + r * Math.sin(angle)).toFixed(1)} ${(48 + r * Math.cos(angle)).toFixed(1)}`;
  const x = 52 + r * Math.sin(stop), y = 48 + r * Math.cos(stop), sweep = turn > 0 ? 0 : 1;
  const head = (turn > 0 ? -turn : -turn + 180) + (turn > 0 ? 13 : -13);
  return [
    draw("path", { class: "way", d: `M${at(Math.sign(turn) * 0.3)}A${r} ${r} 0 ${Math.abs(turn) > 180 ? 1 : 0} ${sweep} ${at(stop)}` }),
    draw("path", { class: "way-head", d: "M5 0-3-4-3 4Z", transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${head.toFixed(1)})` }),
  ];
}

function drawSide(place) {
  const angle = (place.tilt_deg * Math.PI) / 180;
  const x = 30 + 58 * Math.cos(angle), y = 70 - 58 * Math.sin(angle);
  return draw("svg", { viewBox: "0 0 104 104", role: "img", "aria-label": `camera from the side: looks ${place.tilt_deg} degrees down` },
    draw("line", { class: "line", x1: 4, y1: 80, x2: 100, y2: 80 }),
    draw("rect", { class: "body", x: 16, y: 60, width: 28, height: 20, rx: 3 }),
    draw("line", { class: "sight", x1: x, y1: y, x2: 30, y2: 70 }),
    drawCamera(x, y, 180 - place.tilt_deg),
    Object.assign(draw("text", { class: "soft", x: 52, y: 95 }), { textContent: "from the side" }));
}

const SIGNS = { passed: "✓", failed: "✕" };

function gateRow(status, name, unit, value, limit) {
  return make("tr", { class: status }, make("td", {}, SIGNS[status]), make("td", {}, name, make("small", {}, unit)),
    make("td", {}, value, make("small", {}, limit)));
}

const measured = (gate) => gateRow(gate.status, gate.name, gate.unit, gate.value == null ? "" : round(gate.value),
  ` / ${gate.at_most ? "at most" : "at least"} ${round(gate.threshold)}`);

const drawGates = (rows) => make("table", { class: "gates" }, make("tbody", {}, ...rows));

export function drawVerdict(verdict) {
  const { pose, gates } = verdict;
  const failed = gates.filter((gate) => gate.status === "failed");
  const open = gates.filter((gate) => gate.status === "not checked");
  const advice = failed.map((gate) => gate.advice);
  if (pose?.wrong) advice.push([pose.wrong, ...pose.moves].join("; "));
  const bad = failed.map(measured), fine = gates.filter((gate) => gate.status === "passed").map(measured);
  if (pose) {
    const off = `${pose.error_deg}°, ${(pose.error_mm / 10).toFixed(0)} cm`;
    (pose.wrong ? bad : fine).push(gateRow(pose.wrong ? "failed" : "passed", "camera's place", "off the plan's pose", off, ""));
  }
  const hint = pose && !pose.wrong && pose.moves.length ? `Fine as it is; nearer to the plan: ${pose.moves.join(", ")}.` : null;
  const wide = matchMedia("(min-width: 900px)").matches;
  return [
    make("h2", {}, verdict.good ? "Good: keep it" : "Better take it again"),
    advice.length ? make("ul", { class: "advice" }, ...advice.map((line) => make("li", {}, line))) : null,
    hint ? make("p", { class: "soft small" }, hint) : null,
    bad.length ? drawGates(bad) : null,
    fine.length ? make("details", { open: wide }, make("summary", {}, `${fine.length} passed`), drawGates(fine)) : null,
    open.length ? make("details", {}, make("summary", {}, `${open.length} not checked`),
      make("ul", {}, ...open.map((gate) => make("li", {}, `${gate.name}: ${gate.advice.replace(/^not checked: /, "")}`)))) : null,
  ].filter(Boolean);
}

function groupBy(items, key) {
  const groups = new Map();
  for (const item of items) groups.set(item[key], [...(groups.get(item[key]) ?? []), item]);
  return groups;
}

export function drawGrid(shots, current, go) {
  return [...groupBy(shots, "object")].map(([object, own]) => {
    const rows = [...groupBy(own, "variant")].sort(([a], [b]) => (b === "unpatched") - (a === "unpatched"));
    const done = own.filter((shot) => shot.there).length;
    return make("div", { class: "group" },
      make("h3", {}, object, make("span", {}, `${done} of ${own.length}`)),
      ...rows.flatMap(([variant, steps]) => [
        make("p", { class: "row-name" }, variant),
        make("div", { class: "dots" }, ...steps.sort((a, b) => a.number - b.number).map((shot) => make("button", {
          type: "button", class: shot.status === "done" && shot.retake ? "retake" : shot.status, "aria-current": shot.number === current ? "true" : null,
          title: `pose ${shot.pose_id} of the plan`, "aria-label": `shot ${shot.number}, ${object} ${variant}: ${shot.status}`, onclick: () => go(shot.number),
        }, String(shot.number)))),
      ]));
  });
}

function said(row) {
  if (!row) return make("td", {}, make("span", {}, "–"));
  if (row.trouble) return make("td", { class: "wrong" }, row.trouble);
  const own = row.right ? "" : ` · truth ${percent(row.true_probability)}`;
  return make("td", {}, make("b", { class: row.right ? "right" : "wrong" }, `${row.right ? "✓" : "✕"} ${row.label}`), " ",
    make("span", {}, percent(row.probability) + own));
}

export function drawPredictions(session, current) {
  const { network, predictions } = session;
  const notes = network.notes.map((note) => make("p", { class: "soft small" }, note));
  if (network.status === "missing") {
    return [make("p", { class: "soft" }, "No predictions: the photographs are kept all the same."), make("p", { class: "soft small" }, network.message)];
  }
  if (!predictions.length) {
    const words = network.status === "loading" ? "The network is being loaded…" : `${network.message} is ready. Its word on each photograph appears here once you have kept it.`;
    return [make("p", { class: "soft" }, words), ...notes];
  }
  const tally = [...groupBy(predictions, "variant")].map(([variant, rows]) =>
    make("span", {}, make("b", {}, `${rows.filter((row) => row.right).length} of ${rows.length}`), ` right ${variant}`));
  const objects = [...groupBy(predictions, "object")].sort(([a], [b]) => (b === current) - (a === current));
  return [
    make("div", { class: "tally" }, ...tally),
    ...objects.map(([object, rows]) => drawTable(object, rows)),
    make("p", { class: "soft small" }, `${network.message}. Judge a photograph by the gates, not by this table.`), ...notes,
  ];
}

function drawTable(object, rows) {
  const variants = [...new Set(rows.map((row) => row.variant))].sort((a, b) => (b === "unpatched") - (a === "unpatched"));
  const poses = [...groupBy(rows, "pose_id")].sort(([a], [b]) => a - b);
  const head = make("tr", {}, ...["pose", ...variants].map((name) => make("th", { scope: "col" }, name)));
  const body = poses.map(([pose, own]) => make("tr", {}, make("th", { scope: "row" }, String(pose)),
    ...variants.map((variant) => said(own.find((row) => row.variant === variant)))));
  return make("div", { class: "scroll" }, make("table", { class: "said" }, make("caption", {}, object), make("thead", {}, head), make("tbody", {}, ...body)));
}
