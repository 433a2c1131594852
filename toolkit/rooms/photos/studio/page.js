// The page's life: one shot at a time, from the ghost to the verdict to the next one. What counts is on the server.

import { Camera, mayAsk } from "/camera.js";
import { drawGrid, drawPlace, drawPredictions, drawVerdict, make, variantTag } from "/parts.js";

const $ = (id) => document.getElementById(id);
const POLL_MS = 4000, RETRY_MS = 3000, TOAST_MS = 9000;
const camera = new Camera($("video"));
const now = { session: null, shot: null, view: "aim", verdict: null, upload: null, scale: Number(localStorage.getItem("ghost-scale")) || 1, ghost: true };
let turn = 0; // counts the shots that were gone to, so that late answers to an earlier one are dropped

class Trouble extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

async function ask(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { cache: "no-store", ...options });
  } catch {
    throw new Trouble("No connection to the computer. What you kept is safe there.", 0);
  }
  if (answer.status === 403) throw new Trouble("The studio was started anew: open its new address or scan its new code.", 403);
  const body = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
  if (!answer.ok) throw new Trouble(body.error ?? `the server answered ${answer.status}`, answer.status);
  return body;
}

const post = (path) => ask(path, { method: "POST" });
const address = (number) => `/api/shots/${number}`;

function say(message) {
  $("offline").textContent = message ?? "";
  $("offline").hidden = !message;
}

// Runs what may fail, says so in the banner, and tells whether it went well.
async function attempt(work) {
  try {
    await work();
    say(null);
    return true;
  } catch (error) {
    if (!(error instanceof Trouble)) throw error;
    say(error.message);
    return false;
  }
}

async function go(number) {
  const mine = ++turn;
  await attempt(async () => {
    const shot = await ask(address(number));
    if (mine !== turn) return;
    now.shot = shot;
    now.verdict = now.upload = null;
    history.replaceState(null, "", `#${number}`);
    now.view = { waiting: "checking", done: "kept" }[shot.status] ?? "aim";
    render();
    window.scrollTo({ top: 0 });
    if (now.view === "checking") {
      const verdict = await ask(`${address(number)}/verdict`);
      if (mine === turn) showVerdict(verdict);
    }
  });
}

function showVerdict(verdict) {
  now.verdict = verdict;
  now.view = "verdict";
  render();
}

function goNext() {
  if (now.session.next == null) {
    turn++;
    now.shot = null;
    camera.stop();
    history.replaceState(null, "", "#");
    render();
  } else go(now.session.next);
}

// After the shot that was kept come the open ones behind it, then those before.
function nextAfter(number) {
  const open = now.session.shots.filter((shot) => shot.status === "open" || shot.status === "waiting");
  return (open.find((shot) => shot.number > number) ?? open[0])?.number ?? now.session.next;
}

function send(blob, sent) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", `${address(now.shot.number)}/photo`);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.responseType = "json";
    request.upload.onprogress = (event) => event.lengthComputable && sent(event.loaded / event.total);
    request.upload.onload = () => sent(1);
    request.onerror = () => reject(new Trouble("The connection broke. The photograph is still here:", 0));
    request.onload = () => {
      if (request.status === 200) resolve(request.response);
      else if (request.status === 403) reject(new Trouble("The studio was started anew: open its new address or scan its new code.", 403));
      else reject(new Trouble(request.response?.error ?? `the server answered ${request.status}`, request.status));
    };
    request.send(blob);
  });
}

async function upload(blob) {
  const mine = ++turn;
  if (blob.size > now.session.limit_mb * 2 ** 20) {
    say(`This file is larger than ${now.session.limit_mb} MB: set the camera to JPEG or HEIC.`);
    return;
  }
  if (now.upload?.url) URL.revokeObjectURL(now.upload.url);
  now.upload = { blob, url: URL.createObjectURL(blob) };
  now.view = "sending";
  render();
  try {
    const verdict = await send(blob, (share) => mine === turn && showSent(share));
    if (mine !== turn) return;
    say(null);
    if (verdict.there) await refresh(), await go(now.shot.number);
    else showVerdict(verdict);
    await refresh();
  } catch (error) {
    if (!(error instanceof Trouble)) throw error;
    if (mine !== turn) return;
    say(error.message);
    now.view = error.status === 0 ? "broken" : "aim";
    render();
    if (error.status === 0) setTimeout(() => mine === turn && now.view === "broken" && upload(blob), RETRY_MS);
  }
}

function showSent(share) {
  $("sent").value = share;
  if (share >= 1) $("sent").removeAttribute("value");
  $("busy-text").textContent = share < 1 ? `sending ${Math.round(share * 100)} %` : "measuring…";
}

async function refresh() {
  now.session = await ask("/api/state");
  renderSide();
}

const keep = () => act("keep", async () => {
  const number = now.shot.number;
  take(await post(`${address(number)}/keep?sha256=${now.verdict.sha256}`));
  toast(`Kept: ${now.shot.object} ${now.shot.variant}, pose ${now.shot.pose_id}`, number);
  const next = nextAfter(number);
  if (next == null) goNext();
  else await go(next);
});

const retake = () => act("retake", async () => {
  take(await post(`${address(now.shot.number)}/discard`));
  now.view = "aim";
  now.verdict = now.upload = null;
  render();
});

const skip = () => act("skip", async () => {
  const number = now.shot.number;
  take(await post(`${address(number)}/skip`));
  const next = nextAfter(number);
  if (next != null && next !== number) await go(next);
  else render();
});

const takeBack = (number) => act("undo", async () => {
  hideToast();
  take(await post(`${address(number)}/undo`));
  await go(number);
});

function redo() {
  now.view = "aim";
  render();
}

function take(answer) {
  now.shot = answer.shot;
  now.session = answer;
  renderSide();
}

let busy = false;
async function act(name, work) {
  if (busy) return;
  busy = true;
  for (const button of $("actions").querySelectorAll("button")) button.disabled = true;
  const fine = await attempt(work);
  busy = false;
  if (!fine) render();
}

let toastTimer = 0;
function toast(text, number) {
  $("toast-text").textContent = text;
  $("toast-undo").onclick = () => takeBack(number);
  $("toast").hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(hideToast, TOAST_MS);
}

function hideToast() {
  $("toast").hidden = true;
}

function render() {
  renderSide();
  const { shot, view } = now;
  if (!shot) {
    renderFinished();
    return;
  }
  document.querySelector(".shoot").hidden = false;
  $("finished")?.remove();
  $("title").textContent = shot.object;
  $("number").replaceChildren(variantTag(shot.variant), `shot ${shot.number} of ${now.session.shots.length}`);
  $("number").title = `pose ${shot.pose_id} of the plan`;
  $("change").textContent = shot.change ? `Before this shot: ${shot.change}.` : "";
  $("change").hidden = !shot.change || view !== "aim";
  renderStage();
  const verdict = view === "verdict" ? drawVerdict(now.verdict) : view === "kept" ? describeKept() : [];
  $("verdict").replaceChildren(...verdict);
  $("verdict").className = `verdict ${view === "verdict" ? (now.verdict.good ? "good" : "bad") : ""}`;
  $("verdict").hidden = !verdict.length;
  $("place").replaceChildren(...drawPlace(shot.place, now.session.lens));
  $("place").hidden = view === "verdict";
  $("camera-note").textContent = view === "aim" && !mayAsk()
    ? "A browser gives the live camera only to pages on https or on this computer itself. Here the button opens the phone's own camera; frame the shot as the outline above shows it. Its pictures are sharper, too."
    : "";
  renderActions();
}

function describeKept() {
  const { advice, path } = now.shot;
  const words = advice.length ? "It is there, but a gate found it wanting:" : "This shot is there.";
  return [make("h2", {}, words), advice.length ? make("ul", { class: "advice" }, ...advice.map((line) => make("li", {}, line))) : null,
    make("p", { class: "soft small" }, path)].filter(Boolean);
}

function renderStage() {
  const { shot, view } = now;
  const live = view === "aim" && camera.on;
  $("video").hidden = !live;
  const source = { sending: now.upload?.url, broken: now.upload?.url, checking: `${address(shot.number)}/waiting.jpg`,
    verdict: `${address(shot.number)}/waiting.jpg?v=${now.verdict?.sha256.slice(0, 16)}`,
    kept: `${address(shot.number)}/photo.jpg?large=true&v=${now.session.done}` }[view];
  if (source && $("photo").getAttribute("src") !== source) $("photo").src = source;
  $("photo").hidden = !source;
  fitStage();
  $("stage").classList.toggle("filled", live || !!source);
  $("stage").classList.toggle("has-photo", !!source);
  $("stage").classList.toggle("no-ghost", !now.ghost);
  const ghost = `${address(shot.number)}/ghost.png?v=${now.session.list}`;
  if ($("ghost").getAttribute("src") !== ghost) $("ghost").src = ghost;
  const scale = view === "verdict" ? now.verdict.ghost_scale ?? 1 : live ? now.scale : 1;
  $("stage").style.setProperty("--ghost-scale", scale);
  $("scale").value = now.scale;
  $("scale-tool").hidden = !live;
  renderZoom(live);
  $("ghost-toggle").hidden = !live && !source;
  $("ghost-toggle").textContent = now.ghost ? "hide ghost" : "show ghost";
  $("ghost-toggle").setAttribute("aria-pressed", String(now.ghost));
  $("live").hidden = view !== "aim" || !mayAsk();
  $("live").textContent = camera.on ? "switch the live camera off" : "use the live camera";
  $("stage-note").hidden = live || view !== "aim";
  $("tools").hidden = ![...$("tools").children].some((child) => !child.hidden);
  $("busy").hidden = !["sending", "broken", "checking"].includes(view);
  if (view === "broken") $("busy-text").textContent = "trying again…";
  if (view === "checking") showSent(1);
  if (view === "sending") showSent(0);
}

function renderZoom(live) {
  const range = live ? camera.zoom : null;
  $("zoom-tool").hidden = !range;
  if (range) Object.assign($("zoom"), { min: range.min, max: range.max, step: range.step || 0.1 });
}

function renderActions() {
  const button = (id, text, work, kind = "") => make("button", { type: "button", id, class: kind, onclick: work }, text);
  const { view, verdict, shot } = now;
  const good = verdict?.good;
  const row = {
    aim: [
      button("skip", shot.there ? "Cancel" : "Skip", shot.there ? () => go(shot.number) : skip),
      camera.on ? button("shutter", "Take photo", shoot, "main") : button("take", "Take photo", () => $("file").click(), "main"),
      button("choose", "File…", () => $("pick").click()),
    ],
    verdict: [button("retake", "Retake", retake, good ? "" : "main"), button("keep", good ? "Keep" : "Keep anyway", keep, good ? "main good" : "")],
    kept: [button("undo", "Take out", () => takeBack(shot.number)), button("redo", "Redo", redo), button("next", now.session.next == null ? "Done" : "Next shot", goNext, "main")],
    broken: [button("again", "Try again now", () => upload(now.upload.blob), "main")],
  }[view] ?? [];
  $("actions").replaceChildren(...row, $("file"), $("pick"));
  $("actions").hidden = !row.length;
}

function renderFinished() {
  document.querySelector(".shoot").hidden = true;
  $("actions").hidden = true;
  $("finished")?.remove();
  $("main").prepend(make("section", { id: "finished", class: "card finished" }, make("h1", {}, `All ${now.session.shots.length} shots are there`),
    make("p", { class: "soft" }, "End the studio with Ctrl-C in its terminal, then:"), make("p", {}, make("code", {}, "toolkit eval captures/"))));
}

function renderSide() {
  const { session, shot } = now;
  $("count").replaceChildren(make("b", {}, String(session.done)), ` of ${session.shots.length} kept`);
  Object.assign($("progress"), { max: session.shots.length, value: session.done });
  keepFocus($("grid"), () => $("grid").replaceChildren(...drawGrid(session.shots, shot?.number, go)));
  $("predictions").replaceChildren(...drawPredictions(session, shot?.object));
}

// Drawing anew must not take the keyboard's place away.
function keepFocus(box, work) {
  const label = box.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label")?.split(":")[0] : null;
  work();
  if (label) [...box.querySelectorAll("button")].find((one) => one.getAttribute("aria-label").startsWith(`${label}:`))?.focus();
}

async function shoot() {
  $("shutter").disabled = true;
  const blob = await camera.take();
  if (blob) await upload(blob);
}

async function toggleCamera() {
  if (camera.on) camera.stop();
  else {
    try {
      await camera.start();
      say(null);
    } catch (error) {
      camera.stop();
      say(`The live camera cannot be used (${error.name}): take the photograph with the button instead.`);
    }
  }
  render();
}

function takeFile(event) {
  const [file] = event.target.files;
  event.target.value = ""; // the same file may be chosen again
  if (file) upload(file);
}

// The stage has the shape of what is on it, so that the ghost's square is the picture's.
function fitStage() {
  const [video, photo] = [$("video"), $("photo")];
  const [width, height] = !video.hidden ? [video.videoWidth, video.videoHeight] : !photo.hidden ? [photo.naturalWidth, photo.naturalHeight] : [1, 1];
  if (width && height) $("stage").style.setProperty("--aspect", width / height);
}

function listen() {
  $("file").addEventListener("change", takeFile);
  $("pick").addEventListener("change", takeFile);
  $("live").addEventListener("click", toggleCamera);
  $("ghost-toggle").addEventListener("click", () => { now.ghost = !now.ghost; render(); });
  $("scale").addEventListener("input", (event) => {
    now.scale = Number(event.target.value);
    localStorage.setItem("ghost-scale", now.scale);
    $("stage").style.setProperty("--ghost-scale", now.scale);
  });
  $("zoom").addEventListener("input", (event) => camera.setZoom(Number(event.target.value)));
  $("photo").addEventListener("load", fitStage);
  $("photo").addEventListener("error", () => { $("photo").hidden = true; }); // HEIC before it is sent: not every browser shows it
  $("video").addEventListener("resize", fitStage);
  $("stage").addEventListener("dragover", (event) => event.preventDefault());
  $("stage").addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file && now.view === "aim") upload(file);
  });
  window.addEventListener("hashchange", () => { const number = Number(location.hash.slice(1)); if (number) go(number); });
}

async function start() {
  const fine = await attempt(refresh);
  if (!fine) {
    setTimeout(start, RETRY_MS);
    return;
  }
  const asked = Number(location.hash.slice(1));
  if (asked >= 1 && asked <= now.session.shots.length) await go(asked);
  else if (now.session.first != null) await go(now.session.first);
  else goNext();
  setInterval(() => { if (!document.hidden && !["sending", "broken"].includes(now.view)) attempt(refresh); }, POLL_MS);
}

listen();
start();
