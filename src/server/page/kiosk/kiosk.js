// The page of a display box: live frames, pixel for pixel, and the controls of the view.
//
// The address selects the content: view (a shared one, by name), role (presenter or watcher),
// volume, phase, play (phases a second), caption (false leaves the name of the series out of the picture), preset, layout, profile, factor, offset, size (WIDTHxHEIGHT of the picture, if the layout
// has no size of its own), annotations (true, or sets with commas between them) and their author. With output (see outputs.js) the page makes views for other displays:
// views, span, eye, inches, lens, subpixels, swap, distance, layers (1 or 2), and rest (true or synthesised: the views of a picture
// at rest; see true-views.js). Views follow the
// eyes that a client of the view sends, or those of a WebXR session. comfort has the limits of parallax (see comfort.js).

import { onControls } from "./controls.js";
import { comfortOf, comfortProblems, comfortWords, drawHistogram, landmarksOutsideWords, outsideWords, parallaxOf } from "./comfort.js";
import { Panel } from "./panel.js";
import { identityOf } from "/series.js";
import { compose, layoutOf } from "./frame.js";
import { eyesOf, outputOf, screenOf, seenThrough, trackedEyes } from "./outputs.js";
import { showPairing } from "./pairing.js";
import { Session } from "./session.js";
import { SpaceMouse } from "./spacemouse.js";
import { synthesizerOf } from "./synthesizer.js";
import { TrueViews, qualitiesOf } from "./true-views.js";
import { canImmerse, immerse } from "./virtual-screen.js";
import { Wiimote } from "./wiimote.js";

const $ = (id) => document.getElementById(id);
const parameters = new URLSearchParams(location.search);
const canvas = $("frame");
const menu = $("menu");
const CONNECTION = { connecting: "Connecting", live: "", waiting: "No connection; trying again", ended: "Ended" };
/** How long a refusal is displayed, ms. */
const REFUSAL_MS = 8000;
/** Phases a second, where the address has no rate. */
const USUAL_RATE = 10;
const TRACKING = { lost: "Wiimote out of sight", ambiguous: "Wiimote seen from an unclear side", searching: "Looking for the beacon" };

let shown = null;
let connection = { state: "connecting", reason: "" };
let view = null;
/** The name of the displayed series. */
let series = "";
/** Descriptions of volumes, by their id. */
const volumes = new Map();
let tracking = "";
let remote = "";
/** The message about the SpaceMouse. */
let cap = "";
/** Where the viewer's eyes are, and the time from there to the picture, ms. */
let viewer = null;
/** Eyes that are not shown yet, and whether views are on their way. */
let coming = null;
let isFollowing = false;
/** Ends the screen in space, while there is one. */
let leave = null;
/** Time from sending a movement of the view to the frame that shows it, ms. */
let servedMs;
/** Disparity of the frame on the display, as it came. */
let lastDepth = null;
/** The frame that was tested: its layout and size. */
let tested = "";
const arrivals = [];

const panel = new Panel(canvas, selfTest);
const profile = parameters.get("profile") ?? "philips-42";
/** The output that this page makes views for; undefined if the display takes the frames themselves. */
const output = await checked(() => outputOf(parameters));
const comfortLimits = await checked(() => comfortOf(parameters));
const synthesizer = output && (await checked(() => synthesizerOf(parameters.toString(), profile)));
const qualities = await checked(() => qualitiesOf(parameters));
/** The rendered views of a picture at rest, in place of those that the page makes. */
const trueViews = synthesizer && new TrueViews(qualities, { show: showGiven, failed: (reason) => (atRest = reason) });
/** The picture while nothing moves. */
let atRest = "";
/** The parallax of the frame on the display. */
let comfort = null;
/** Times of the view synthesis of the last frames, ms. */
const madeMs = [];
/** For scripts that drive the page: the current view, from the state in every frame. */
Object.defineProperty(window, "kioskView", { get: () => view?.state ?? null });

/** The value that `read` reads from the address; an invalid address ends the page with the reason. */
async function checked(read) {
  try {
    return await read();
  } catch (error) {
    $("state").textContent = error.message;
    document.documentElement.dataset.connection = "ended";
    throw error;
  }
}

/** The frame for the panel. */
async function frameOf(header, layers) {
  return synthesizer ? made(await synthesizer.frame(header.full, layers, header.display)) : compose(header, layers);
}

/** The picture that the view synthesis has made. */
function made({ image, ms }) {
  if (image) madeMs.push(ms);
  while (madeMs.length > 30) madeMs.shift();
  return image;
}

/** Shows the newest frame for other eyes, at the next refresh of the screen; eyes that come meanwhile are next. */
async function follow(eyes) {
  coming = { eyes, since: coming?.since ?? performance.now() };
  if (!synthesizer || isFollowing) return;
  isFollowing = true;
  while (coming) {
    // A screen in space has refreshes of its own, and begins each with its eyes.
    if (!leave) await new Promise(requestAnimationFrame);
    await showFor(coming).catch((error) => refused(error.message));
  }
  isFollowing = false;
}

/** Shows rendered views, unless the picture has moved. */
async function showGiven(size, pixels, quality, signal) {
  const image = made(await synthesizer.give(pixels));
  if (signal.aborted) return;
  panel.show(image);
  atRest = `${quality} views of the server`;
  document.documentElement.dataset.views = quality;
}

/** The picture or the eyes have come to rest. */
function rested() {
  if (!trueViews || !view || !shown?.still || leave) return;
  const { distance } = screenOf(output, profile);
  const tracked = viewer && trackedEyes({ ...output, distance }, viewer.eyes);
  trueViews.rest(view.name, seenThrough(output, profile, eyesOf({ ...output, tracked })), shown.full);
}

/** The picture or the eyes move. */
function moved() {
  trueViews?.moved();
  atRest = "";
  delete document.documentElement.dataset.views;
}

async function showFor({ eyes, since }) {
  coming = null;
  moved();
  const image = made(await synthesizer.follow(eyes));
  if (!image) return;
  panel.show(image);
  viewer = { eyes, shownMs: performance.now() - since, count: (viewer?.count ?? 0) + 1 };
  document.documentElement.dataset.eyes = viewer.count;
  rested();
}

/** Shows both views on a screen in space, or ends that. */
async function toggleSpace() {
  if (leave) return leave();
  const { screenWidthMm, distance } = screenOf(output, profile);
  const ended = () => {
    leave = null;
    delete document.documentElement.dataset.space;
  };
  try {
    leave = await immerse({ panel: canvas, width: screenWidthMm / 1000, distance: distance / 1000, follow, ended });
    document.documentElement.dataset.space = "";
  } catch (error) {
    refused(`The screen in space did not open: ${error.message}`);
    describe();
  }
}

/** The state of the viewer. */
function viewerWords() {
  if (!viewer?.shownMs) return "";
  const [left, right] = [viewer.eyes.left_mm, viewer.eyes.right_mm];
  const [x, y, z] = left.map((mm, i) => (mm + right[i]) / 2);
  return `${z.toFixed(0)} mm away, ${x.toFixed(0)} mm to the right, ${y.toFixed(0)} mm up; shown ${viewer.shownMs.toFixed(1)} ms after they came`;
}

/** The layout that the server sends: with a back layer or without one where this page makes views. */
function layoutToAsk() {
  if (!output) return parameters.get("layout") ?? "wowvx";
  return parameters.get("layers") === "2" ? "declipse" : "rgbd";
}

function helloOf() {
  const number = (name) => (parameters.has(name) ? { [name]: Number(parameters.get(name)) } : {});
  const text = (name) => (parameters.has(name) ? { [name]: parameters.get(name) } : {});
  const display = { layout: layoutToAsk(), ...text("profile"), ...number("factor"), ...number("offset") };
  const size = parameters.get("size")?.split("x").map(Number);
  // The picture names its series unless the address has caption=false.
  const caption = parameters.get("caption") === "false" ? {} : { scene: { overlays: { caption: true } } };
  const play = parameters.has("play") ? { play: { phases_per_s: Number(parameters.get("play")) } } : {};
  const settings = { display, ...text("preset"), ...(size ? { size_px: size } : {}), ...drawnSets(), ...number("phase"), ...play, ...caption };
  return { ...text("volume"), ...text("view"), ...text("role"), ...text("author"), settings };
}

/** The sets of annotations that the view draws: all, or those that the address names. */
function drawnSets() {
  const sets = parameters.get("annotations");
  if (sets === null) return {};
  return { annotations: sets === "true" || sets === "false" ? sets === "true" : sets.split(",") };
}

const session = new Session(helloOf(), {
  async show(header, layers) {
    moved();
    panel.show(await frameOf(header, layers));
    servedMs = session.delayOf(header.showsSeq) ?? servedMs;
    shown = header;
    lastDepth = layers[0].depth;
    arrivals.push(performance.now());
    while (arrivals.length > 30) arrivals.shift();
    // Screen readers would read text on the frame with each change.
    canvas.setAttribute("aria-label", "The volume in colour and depth");
    Object.assign(document.documentElement.dataset, { frame: header.sequence, shows: header.showsSeq, still: header.still });
    // Reading the canvas back costs as much as drawing it. After a good result, once a second is
    // enough.
    if (tested !== kindOf(header)) selfTest();
    rested();
  },
  heard(message) {
    if (message.type === "welcome") document.title = series = identityOf(message.volume);
    if (message.type === "welcome") view = { name: message.view, role: message.role, color: message.color, state: message.state };
    if (message.type === "welcome") volumes.set(message.volume.id, message.volume);
    if (message.type === "state") {
      view = { ...view, state: message.state, outside: message.outside, phasesPerS: message.phases_per_s };
      nameSeries(message.volume);
    }
    if (message.type === "eyes") follow(message);
    if (message.type === "tracking") tracking = message.state;
    if (message.type === "error") refused(message.problem.detail ?? message.problem.title);
    if (tracking) document.documentElement.dataset.tracking = tracking;
    describe();
  },
  changed(state, reason = "") {
    connection = { state, reason };
    describe();
  },
});

/** Names the displayed series, which another client of the view may have changed. */
async function nameSeries(id) {
  if (!volumes.has(id)) {
    volumes.set(id, null); // fetched once
    const answer = await fetch(`/v1/volumes/${id}`).catch(() => null);
    if (answer?.ok) volumes.set(id, await answer.json());
    else volumes.delete(id);
  }
  const volume = volumes.get(id);
  if (volume) document.title = series = identityOf(volume);
}

/** Plays the phases of the series, or stops. */
function togglePlaying() {
  const rate = Number(parameters.get("play")) || USUAL_RATE;
  session.settings({ play: view?.phasesPerS ? false : { phases_per_s: rate } });
}

const wiimote = new Wiimote({
  report: (report) => session.report(report),
  changed(words) {
    remote = words;
    describe();
  },
});

const spacemouse = new SpaceMouse({
  send: (intent) => session.intent(intent),
  changed(words) {
    cap = words;
    describe();
  },
});

// ---------------------------------------------------------------- messages

/** Displays a refusal for a few seconds. */
function refused(reason) {
  connection.reason = reason;
  setTimeout(() => {
    if (connection.reason === reason) connection.reason = "";
    describe();
  }, REFUSAL_MS);
}

function words() {
  const network = [CONNECTION[connection.state], connection.reason].filter(Boolean).join(": ");
  return [network, remote, cap, TRACKING[tracking]].filter(Boolean).join(" · ");
}

/** The frame rate over the last thirty frames. */
function rate() {
  const recent = arrivals.filter((at) => performance.now() - at < 3000);
  return recent.length > 2 ? ((recent.length - 1) * 1000) / (recent.at(-1) - recent[0]) : 0;
}

function describe() {
  const said = words();
  if ($("state").textContent !== said) $("state").textContent = said;
  $("state").classList.toggle("bad", connection.state !== "live");
  document.documentElement.dataset.connection = connection.state;
  if (menu.open) fillFacts();
}

const kindOf = ({ layout, full }) => `${layout} ${full.join(" ")}`;

/** Whether the pixels reach the panel unchanged; on the root element, for tests. */
function selfTest() {
  if (!shown) return;
  tested = kindOf(shown);
  const found = panel.problems(!output && layoutOf(shown.layout).hasHeader);
  document.documentElement.dataset.test = found.length ? "bad" : "good";
  if (!menu.open) return;
  $("test").className = found.length ? "bad" : "good";
  $("test").textContent = found.length ? "The panel does not receive the frame unchanged." : "The panel receives every pixel unchanged.";
  $("problems").replaceChildren(...found.map((problem) => Object.assign(document.createElement("li"), { textContent: problem })));
}

/** Measures the parallax of the frame, and says where it is uncomfortable; on the root element, for tests. */
function checkComfort() {
  if (!lastDepth) return;
  comfort = parallaxOf(lastDepth, profile, shown.display);
  const outside = [outsideWords("The cursor", view?.state?.cursor_mm, shown), landmarksOutsideWords(view?.outside)];
  const found = [...comfortProblems(comfort, comfortLimits), ...outside].filter(Boolean);
  document.documentElement.dataset.comfort = found.length ? "bad" : "good";
  if (!menu.open) return;
  $("comfort").replaceChildren(...found.map((problem) => Object.assign(document.createElement("li"), { textContent: problem })));
  drawHistogram($("histogram"), comfort, comfortLimits);
}

function fillFacts() {
  if (!shown) return;
  const { full, size, lossless, layout, totalUs, renderUs } = shown;
  const facts = {
    Series: series,
    View: view ? `${view.name}, ${view.role}` : "",
    Layout: `${output ? output.words : layout}, ${canvas.width} × ${canvas.height}`,
    Views: output ? `${output.views}, made ${synthesizer.place} in ${Math.max(...madeMs).toFixed(1)} ms at most` : "",
    Picture: `${size.join(" × ")} of ${full.join(" × ")}, ${lossless ? "lossless" : "JPEG"}`,
    Rate: rate() > 0 ? `${rate().toFixed(1)} frames/s` : "standing still",
    Server: `${(totalUs / 1000).toFixed(1)} ms, of that ${(renderUs / 1000).toFixed(1)} ms rendering`,
    Delay: servedMs === undefined ? "" : `a movement is shown ${servedMs.toFixed(1)} ms after it was sent`,
    "At rest": atRest,
    Eyes: viewerWords(),
    Parallax: comfort ? comfortWords(comfort) : "",
    Preset: view?.state?.preset ?? "",
  };
  const entries = Object.entries(facts).filter(([, fact]) => fact);
  const row = ([name, fact]) => ["dt", "dd"].map((tag, at) => Object.assign(document.createElement(tag), { textContent: at ? fact : name }));
  $("facts").replaceChildren(...entries.flatMap(row));
}

// ---------------------------------------------------------------- input

function toggleMenu() {
  if (menu.open) menu.close();
  else menu.showModal();
  tick();
}

function tick() {
  selfTest();
  checkComfort();
  describe();
}

const toggleFull = () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen());

async function connectWiimote() {
  if (!Wiimote.isPossible) return;
  await wiimote.choose().catch((error) => (remote = error.message));
  describe();
}

async function connectSpaceMouse() {
  if (!Wiimote.isPossible) return;
  await spacemouse.choose().catch((error) => (cap = error.message));
  describe();
}

/** Shows the code that makes a phone a wand, in the menu. */
async function pairPhone() {
  if (!view) return;
  if (!menu.open) toggleMenu();
  await showPairing(view.name).catch((error) => refused(error.message));
  describe();
}

/** The picture's pixel under a position: the left half of a frame, on every line or every other one. */
function placeOf(x, y) {
  const at = shown && panel.pixelAt(x, y);
  if (!at) return null;
  const ofFrame = () => [at[0], at[1] / (layoutOf(shown.layout).placement?.lineStep ?? 1)];
  const [u, v] = output ? output.place(at, shown.full) : ofFrame();
  return u < shown.full[0] && v < shown.full[1] ? [u, v] : null;
}

/** 1 to 9 are the first presets, in the order of the workstation's. */
const presetKeys = Object.fromEntries([1, 2, 3, 4, 5, 6, 7, 8, 9].map((digit) => [digit, () => choosePreset(digit - 1)]));
let presets = null;

async function choosePreset(at) {
  try {
    presets ??= fetch("/v1/presets").then((answer) => answer.json()).then((known) => known.presets.map(({ name }) => name));
    const name = (await presets)[at];
    if (name) session.intent({ intent: "preset", name });
  } catch (error) {
    presets = null; // asked for again by the next key
    refused(`The presets are not known: ${error.message}`);
    describe();
  }
}

onControls(canvas, {
  send: (intent) => session.intent(intent),
  placeOf,
  keys: { ...presetKeys, c: togglePlaying, m: toggleMenu, "?": toggleMenu, f: toggleFull, w: connectWiimote, s: connectSpaceMouse, p: pairPhone, v: () => !$("space").hidden && toggleSpace() },
});
$("full").addEventListener("click", toggleFull);
$("close").addEventListener("click", toggleMenu);
$("wiimote").addEventListener("click", connectWiimote);
$("wand").addEventListener("click", pairPhone);
$("spacemouse").addEventListener("click", connectSpaceMouse);
$("space").addEventListener("click", toggleSpace);
if (output?.name === "stereo") canImmerse().then((can) => ($("space").hidden = !can));
$("wiimote").hidden = $("spacemouse").hidden = !Wiimote.isPossible;
menu.addEventListener("keydown", (event) => ["m", "?"].includes(event.key) && toggleMenu());
setInterval(tick, 1000);
canvas.focus();
wiimote.reopen();
spacemouse.reopen();
