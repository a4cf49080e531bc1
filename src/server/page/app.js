// The page: wires controls, pointer and keyboard to a view, and draws what comes back.
//
// A change asks at once for a picture under a budget of time, and for a whole one when things are still. Clicks ask for the patient
// position under them in the very picture that is shown.

import { drawPicture } from "./draw.js";
import { onFile, saveAs, uploadZip } from "./files.js";
import { onDivider, onGestures } from "./gestures.js";
import { ALL_SHOWN, kept as keptLabels, onSegments, recalled as recalledLabels, showSegments } from "./labels.js";
import { NO_LIGHT, describeLight, fillLights, keptLight, onLight, recalledLight } from "./light.js";
import { PresetGrid } from "./presets.js";
import { Preview } from "./preview.js";
import { describeSurface, onSurface } from "./surface.js";
import {
  Fetcher, HOME, Refusal, firstPasses, frameQuery, morePasses, normalized, project, request, stageQuery, stillSize,
} from "./view.js";
import {
  NO_SLICE, PLANES, dragged, kept as keptSlice, onControls, paged, recalled, showControls, sliceWords, zoomed,
} from "./slices.js";

const $ = (id) => document.getElementById(id);
const stage = $("stage");
const canvas = $("picture");
const context = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
const panel = $("panel");

const VIEWS = ["picture", "depth", "split", "frame"];
const SIDES = { a: [0, 0], p: [180, 0], l: [90, 0], r: [-90, 0], s: [0, 90], i: [0, -90] };
/** A pause this long counts as standing still. */
const STILL_MS = 220;
const DOT = " · ";

const state = {
  volume: null,
  pose: { ...HOME },
  slice: { ...NO_SLICE },
  preset: "bone",
  mode: "composite",
  /** HU of the surface; the server's choice for the preset while null. */
  iso: null,
  light: { ...NO_LIGHT },
  overlays: [],
  labels: { ...ALL_SHOWN },
  fieldOfView: 22,
  view: "picture",
  layout: "wowvx",
  profile: "",
  factor: 64,
  offset: 128,
  depthFilter: "none",
  depthRule: "threshold",
  split: 0.5,
};

let presets = [];
let volumes = [];
let shown = null;
let pick = null;
let stillTimer = 0;

const fetcher = new Fetcher(show, showFailure, (busy) => $("busy").classList.toggle("on", busy));
const preview = new Preview($("preview"), panel.querySelectorAll('input[name="preview"]'), state, showFailure);
const grid = new PresetGrid($("presets"), $("presets"), () => fetcher.isBusy);

// ---------------------------------------------------------------- asking for pictures

const volumePath = (part) => `/v1/volumes/${state.volume.id}/${part}`;

/** Asks for the picture of the present state; while moving one under a budget, and a whole one after a pause. */
function refresh({ moving = false } = {}) {
  if (!state.volume) return;
  clearTimeout(stillTimer);
  if (moving) stillTimer = setTimeout(refresh, STILL_MS);
  fetcher.want(state.view === "frame" ? frameOrder(moving) : stageOrder(moving));
  preview.changed();
  describePose();
}

function frameOrder(moving) {
  return { url: `${volumePath("frame")}?${frameQuery(state, moving)}`, accept: "image/png", kind: "frame", moving };
}

/** While moving, colour alone is enough for the picture; else colour and depth come side by side in one PNG. */
function stageOrder(moving, passes = firstPasses(state, moving), before = 0) {
  const { clientWidth, clientHeight } = stage;
  const full = stillSize(clientWidth, clientHeight, Math.min(2, devicePixelRatio));
  const kind = moving && state.view === "picture" ? "color" : "rgbd";
  // A lossless picture of full size takes longer to pack than to render.
  const size = moving && kind === "rgbd" ? full.map((side) => Math.ceil(side / 2)) : full;
  const query = stageQuery(state, size, kind, { passes, moving });
  const accept = kind === "color" ? "image/jpeg" : "image/png";
  return { url: `${volumePath("frame")}?${query}`, accept, kind, moving, query, size, passes, added: passes - before };
}

/** A path-traced picture that stands still gets more passes, until it has enough or something changes. */
function refine(picture) {
  const passes = picture.kind === "rgbd" ? morePasses(picture) : undefined;
  if (passes !== undefined && !fetcher.hasWish) fetcher.want(stageOrder(false, passes, picture.passes));
}

// ---------------------------------------------------------------- showing them

function show(picture) {
  shown?.bitmap.close();
  shown = picture;
  draw();
  placeMarker();
  // The picture's own directions, whatever was asked for since.
  for (const edge of ["left", "right", "top", "bottom"]) {
    $(`edge-${edge}`).textContent = picture.camera?.edges[edge] ?? "";
    $(`edge-${edge}`).hidden = picture.kind === "frame";
  }
  const { queue = 0, render = 0, upload = 0, overlay = 0, encode = 0 } = picture.spent;
  const [width, height] = picture.camera?.size_px ?? [picture.bitmap.width, picture.bitmap.height];
  const ms = (value) => `${Math.round(value)} ms`;
  const rendered = render + upload > 0 ? `render ${ms(render + upload + overlay)}` : "render reused";
  const spent = [`queue ${ms(queue)}`, rendered, `encode ${ms(encode)}`, `in all ${ms(picture.totalMs)}`];
  const rays = picture.quality?.reduced ? [`rays ${picture.quality.rays_px.join(" × ")}`] : [];
  const passes = picture.passes === undefined ? [] : [`${picture.passes} passes`];
  $("timing").textContent = [`${width} × ${height}`, ...rays, ...passes, ...spent].join(DOT);
  refine(picture);
}

function showFailure(error) {
  if (error) {
    const known = error instanceof Refusal;
    return notify(known ? error.message : `The picture cannot be shown: ${error.message}`, true);
  }
  if ($("notice").classList.contains("error")) $("notice").hidden = true;
}

function notify(text, isError = false) {
  const notice = $("notice");
  notice.textContent = text;
  notice.classList.toggle("error", isError);
  notice.hidden = false;
  if (!isError) setTimeout(() => (notice.hidden ||= notice.textContent === text), 5000);
}

/** Draws what is shown in the view that is chosen. */
function draw() {
  if (!shown) return;
  drawPicture(context, shown, state, stage.clientWidth * devicePixelRatio);
}

/** Says in words and letters from where the volume is seen. */
function describePose() {
  const { azimuth, elevation, zoom } = state.pose;
  const pose = [`azimuth ${azimuth.toFixed(0)}°`, `elevation ${elevation.toFixed(0)}°`, `zoom ${zoom.toFixed(2)}`];
  const slice = state.slice.plane && state.volume ? sliceWords(state.slice, state.volume) : null;
  $("pose").textContent = (slice ?? pose).join(DOT);
  const what = slice ? `slice, ${slice.join(", ")}` : `volume, preset ${state.preset}, ${pose.slice(0, 2).join(", ")}`;
  canvas.setAttribute("aria-label", `${state.view} of the ${what}`);
  showControls($, state.slice, state.volume);
  $("divider").hidden = state.view !== "split";
  $("divider").style.left = `${state.split * 100}%`;
  $("divider").setAttribute("aria-valuenow", Math.round(state.split * 100));
  remember();
}

// ---------------------------------------------------------------- picks

const lps = ([x, y, z]) =>
  [[x, "L", "R"], [y, "P", "A"], [z, "H", "F"]]
    .map(([value, positive, negative]) => `${value < 0 ? negative : positive} ${Math.abs(value).toFixed(1)}`)
    .join(", ");

/** Asks what is shown at a point of the stage, in fractions of its width and height. */
async function pickAt([x, y]) {
  if (!shown?.query) return;
  const { query, size } = shown;
  const at = new URLSearchParams(query);
  // Of a picture under a budget the whole one is asked: it is on its way already.
  at.delete("budget_ms");
  at.set("u", Math.min(size[0] - 0.01, x * size[0]).toFixed(2));
  at.set("v", Math.min(size[1] - 0.01, y * size[1]).toFixed(2));
  try {
    const found = await (await request(`${volumePath("pick")}?${at}`)).json();
    pick = found.hit ? { patient: found.patient_mm, text: pickText(found) } : null;
    if (!found.hit) notify("Nothing is shown there.");
  } catch (error) {
    showFailure(error);
  }
  placeMarker();
}

const pickText = (found) => [
  ["Patient", `${lps(found.patient_mm)} mm`],
  ["LPS", found.patient_mm.map((value) => value.toFixed(2)).join(", ")],
  ["View depth", `${found.depth_mm.toFixed(1)} mm`],
  ...(found.segment ? [["Segment", found.segment.name ?? `label ${found.segment.label}`]] : []),
];

/** The marker stays on its place in the patient while the volume turns. */
function placeMarker() {
  // A frame is for a display: nothing may lie over it.
  const overlays = state.view !== "frame";
  $("picked").hidden = !pick || !overlays;
  const at = pick && overlays && shown?.camera && shown.kind !== "frame" ? project(pick.patient, shown.camera) : null;
  const inside = at && at.every((value) => value >= 0 && value <= 1);
  $("marker").hidden = !inside;
  if (inside) {
    $("marker").style.left = `${at[0] * 100}%`;
    $("marker").style.top = `${at[1] * 100}%`;
  }
  if (pick) {
    $("picked").replaceChildren(
      ...pick.text.map(([name, value]) => {
        const line = document.createElement("div");
        const term = document.createElement("b");
        term.textContent = `${name}  `;
        line.append(term, value);
        return line;
      }),
    );
  }
}

function forgetPick() {
  pick = null;
  placeMarker();
}

// ---------------------------------------------------------------- pointer

const slicing = () => state.slice.plane !== "" && state.volume !== null;

function setSlice(change, moving = true) {
  if (!state.volume) return;
  state.slice = change(state.slice);
  refresh({ moving });
}

/** Another plane through the same place, or the volume again. */
function showPlane(plane) {
  state.slice = { ...state.slice, plane };
  choose("plane", plane);
  refresh();
}

function setPose(change, { moving = true } = {}) {
  state.pose = normalized({ ...state.pose, ...change });
  refresh({ moving });
}

onGestures(stage, $("divider"), {
  turn(dx, dy) {
    if (slicing()) {
      const { clientWidth, clientHeight } = stage;
      const drag = [dx / clientHeight, dy / clientHeight];
      return setSlice((slice) => dragged(slice, state.volume, drag, clientWidth / clientHeight));
    }
    // Half a turn across the stage's height; finer when close.
    const degrees = 180 / stage.clientHeight / Math.max(1, Math.sqrt(state.pose.zoom));
    setPose({ azimuth: state.pose.azimuth - dx * degrees, elevation: state.pose.elevation + dy * degrees });
  },
  zoom(ratio, wheel) {
    if (!slicing()) return setPose({ zoom: state.pose.zoom * ratio });
    if (!wheel || wheel.ctrlKey) return setSlice((slice) => zoomed(slice, ratio));
    setSlice((slice) => paged(slice, state.volume, Math.sign(ratio - 1)));
  },
  click: pickAt,
  double: reset,
});

onDivider(stage, $("divider"), (fraction) => {
  state.split = Math.min(0.98, Math.max(0.02, fraction));
  describePose();
  draw();
});

// ---------------------------------------------------------------- keyboard

function reset() {
  forgetPick();
  if (slicing()) return setSlice((slice) => ({ ...slice, at: null, zoom: 1 }), false);
  setPose({ ...HOME }, { moving: false });
}

function choose(name, value) {
  const input = panel.querySelector(`input[name="${name}"][value="${value}"]`);
  if (input) input.checked = true;
}

function setView(view) {
  state.view = view;
  choose("view", view);
  // What is shown may hold all that is needed already.
  const enough = shown?.kind === "rgbd" && !shown.moving && view !== "frame";
  placeMarker();
  if (!enough) return refresh();
  draw();
  describePose();
}

function setPreset(index) {
  if (!presets[index]) return;
  const { name, purpose, mode } = presets[index];
  Object.assign(state, { preset: name, mode });
  $("mode").value = mode;
  describeSurface(state);
  describeLight(state);
  grid.choose(index);
  $("purpose").textContent = purpose;
  refresh();
}

function turnOrZoom(event) {
  const step = event.shiftKey ? 1 : 6;
  const { azimuth, elevation, zoom } = state.pose;
  if (slicing()) {
    const pages = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
    const ratio = { "+": 1.15, "=": 1.15, "-": 1 / 1.15, _: 1 / 1.15 }[event.key];
    if (pages) return setSlice((slice) => paged(slice, state.volume, event.shiftKey ? 10 * pages : pages));
    return ratio ? setSlice((slice) => zoomed(slice, ratio)) : reset();
  }
  switch (event.key) {
    case "ArrowLeft": return setPose({ azimuth: azimuth + step });
    case "ArrowRight": return setPose({ azimuth: azimuth - step });
    case "ArrowUp": return setPose({ elevation: elevation - step });
    case "ArrowDown": return setPose({ elevation: elevation + step });
    case "+": case "=": return setPose({ zoom: zoom * 1.15 });
    case "-": case "_": return setPose({ zoom: zoom / 1.15 });
    case "Home": case "0": return reset();
  }
}

function command(key) {
  if (SIDES[key]) {
    if (slicing()) showPlane("");
    const [azimuth, elevation] = SIDES[key];
    return setPose({ azimuth, elevation }, { moving: false });
  }
  if (/^[1-9]$/.test(key)) return setPreset(Number(key) - 1);
  switch (key) {
    case "d": return setView(VIEWS[(VIEWS.indexOf(state.view) + 1) % VIEWS.length]);
    case "m":
      $("mode").selectedIndex = ($("mode").selectedIndex + 1) % $("mode").length;
      return $("mode").dispatchEvent(new Event("change", { bubbles: true }));
    case "v": {
      const planes = ["", ...Object.keys(PLANES)];
      return showPlane(planes[(planes.indexOf(state.slice.plane) + 1) % planes.length]);
    }
    case "f": return fullScreen();
    case "?": return $("help").showModal();
    case "escape": return forgetPick();
  }
}

const TURNING = /^(Arrow.*|Home|[+=\-_0])$/;

document.addEventListener("keydown", (event) => {
  const at = event.target;
  if (event.ctrlKey || event.metaKey || event.altKey || $("help").open || at.closest("select, dialog")) return;
  if (TURNING.test(event.key)) {
    // Arrows belong to a control that has the focus and moves by them.
    if (at.matches("input") || at === $("divider")) return;
    event.preventDefault();
    turnOrZoom(event);
  } else {
    command(event.key.toLowerCase());
  }
});

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else stage.requestFullscreen?.().catch(() => notify("This browser refuses full screen."));
}

// ---------------------------------------------------------------- settings

panel.addEventListener("submit", (event) => event.preventDefault());

const overlayBoxes = () => [...panel.querySelectorAll('input[name="overlay"]')];

panel.addEventListener("change", ({ target }) => {
  if (target.name === "view") return setView(target.value);
  if (target.name === "plane") return showPlane(target.value);
  if (target.id === "mode") state.mode = target.value;
  else if (target.name === "overlay") state.overlays = overlayBoxes().filter((box) => box.checked).map((box) => box.value);
  else if (target.name === "projection") state.fieldOfView = Number(target.value);
  else if (target.name === "preset") return setPreset(Number(target.value));
  else if (target.id === "depth-filter") state.depthFilter = target.value;
  else if (target.id === "depth-rule") state.depthRule = target.value;
  else if (target.id === "volume") return showVolume(volumes[target.selectedIndex]);
  else if (target.id === "layout" || target.id === "profile") {
    state[target.id] = target.value;
    preview.changed();
    return state.view === "frame" ? refresh() : remember();
  } else return;
  describeSurface(state);
  describeLight(state);
  refresh();
});
onSurface(state, () => refresh({ moving: true }));
onLight(state, () => refresh({ moving: true }));

for (const id of ["factor", "offset"]) {
  $(id).addEventListener("input", ({ target }) => {
    state[id] = Number(target.value);
    describeHeader();
    preview.changed();
    // The depth view shows their effect at once; a frame has to be made anew.
    if (state.view === "frame") refresh({ moving: true });
    else draw();
  });
}

onControls($, () => state.volume, (change, moving) => setSlice(change, moving));

onSegments(() => state.labels, (labels, moving) => {
  state.labels = labels;
  refresh({ moving });
});

function describeHeader() {
  $("factor-value").textContent = `${Math.round((state.factor / 64) * 100)} %`;
  $("offset-value").textContent = String(state.offset);
}

$("reset").addEventListener("click", reset);
$("full-screen").addEventListener("click", fullScreen);
$("help-button").addEventListener("click", () => $("help").showModal());

// ---------------------------------------------------------------- downloads and uploads

async function save(button, part, accept, ending) {
  if (!state.volume) return;
  const { azimuth, elevation } = state.pose;
  const view = `${state.preset}-az${azimuth.toFixed(0)}-el${elevation.toFixed(0)}`;
  const name = `relief-${slicing() ? state.slice.plane : view}-${part}.${ending}`;
  button.disabled = true;
  await saveAs(name, `${volumePath(part)}?${frameQuery(state)}`, accept).catch(showFailure);
  button.disabled = false;
}

$("save-frame").addEventListener("click", ({ currentTarget }) => save(currentTarget, "frame", "image/png", "png"));
$("save-exr").addEventListener("click", ({ currentTarget }) => save(currentTarget, "frame", "image/x-exr", "exr"));
$("save-depth").addEventListener("click", ({ currentTarget }) => save(currentTarget, "depth", "image/png", "png"));

$("copy-link").addEventListener("click", async () => {
  if (!state.volume) return;
  const address = `${location.origin}${volumePath("frame")}?${frameQuery(state)}`;
  try {
    await navigator.clipboard.writeText(address);
    notify("Copied: the address answers with the frame as it is now.");
  } catch {
    notify(address); // clipboards are for secure pages alone
  }
});

onFile(stage, $("upload-button"), $("upload"), async (file) => {
  notify(`Reading ${file.name} …`);
  try {
    const { id } = await uploadZip(file);
    await listVolumes();
    showVolume(volumes.find((volume) => volume.id === id));
  } catch (error) {
    showFailure(error);
  }
});

// ---------------------------------------------------------------- start

/** The state in the address: a reload or a link shows the same view. */
function remember() {
  if (!state.volume) return;
  const { azimuth, elevation, zoom } = state.pose;
  const { preset, mode, iso, view, layout, overlays, fieldOfView, depthFilter: filter, depthRule: rule } = state;
  const kept = { volume: state.volume.id, preset, mode, view, layout, filter, rule, fov: fieldOfView };
  if (iso !== null) kept.iso = iso;
  if (overlays.length) kept.overlay = overlays.join(",");
  const pose = { az: azimuth.toFixed(1), el: elevation.toFixed(1), zoom: zoom.toFixed(2) };
  history.replaceState(null, "", `#${new URLSearchParams({ ...kept, ...pose, ...keptSlice(state.slice), ...keptLight(state.light), ...keptLabels(state.labels) })}`);
}

function recall() {
  const kept = new URLSearchParams(location.hash.slice(1));
  const number = (name, otherwise) => {
    const value = Number(kept.get(name) ?? NaN);
    return Number.isFinite(value) ? value : otherwise;
  };
  const word = (name, allowed) => (allowed.includes(kept.get(name)) ? kept.get(name) : undefined);
  const { azimuth, elevation, zoom } = HOME;
  state.pose = normalized({
    azimuth: number("az", azimuth),
    elevation: number("el", elevation),
    zoom: number("zoom", zoom),
  });
  state.slice = recalled(kept);
  state.labels = recalledLabels(kept);
  choose("plane", state.slice.plane);
  state.fieldOfView = number("fov", 22) === 0 ? 0 : 22;
  state.preset = word("preset", presets.map((preset) => preset.name)) ?? presets[0].name;
  const chosen = presets.findIndex((preset) => preset.name === state.preset);
  state.mode = word("mode", [...$("mode").options].map((option) => option.value)) ?? presets[chosen].mode;
  const switched = (kept.get("overlay") ?? "").split(",");
  for (const box of overlayBoxes()) box.checked = switched.includes(box.value);
  state.overlays = overlayBoxes().filter((box) => box.checked).map((box) => box.value);
  state.view = word("view", VIEWS) ?? "picture";
  const values = (id) => [...$(id).options].map((option) => option.value);
  state.layout = word("layout", values("layout")) ?? "wowvx";
  state.depthFilter = word("filter", values("depth-filter")) ?? "none";
  state.depthRule = word("rule", values("depth-rule")) ?? "threshold";
  $("depth-filter").value = state.depthFilter;
  $("depth-rule").value = state.depthRule;
  choose("view", state.view);
  choose("projection", state.fieldOfView);
  state.iso = kept.has("iso") ? number("iso", 300) : null;
  describeSurface(state);
  state.light = recalledLight(kept);
  describeLight(state);
  for (const id of ["mode", "layout"]) $(id).value = state[id];
  grid.choose(chosen);
  $("purpose").textContent = presets[chosen].purpose;
  return kept.get("volume");
}

const option = (value, text = value) => new Option(text, value);

function facts({ dims, spacing_mm: spacing, hu_range: [low, high], warnings }) {
  const size = dims.join(" × ");
  const step = spacing.map((value) => Number(value.toFixed(3))).join(" × ");
  const known = [`${size} voxels`, `${step} mm`, `${low} to ${high} HU`];
  if (warnings) known.push(`${warnings} warning${warnings > 1 ? "s" : ""} on reading`);
  return known.join(DOT);
}

function showVolume(volume) {
  if (!volume) return;
  state.volume = volume;
  // A place in one volume is none in another.
  if (shown) {
    state.slice = { ...state.slice, at: null };
    state.labels = { ...state.labels, cut: [] };
  }
  showSegments(volume, state.labels);
  $("volume").value = volume.id;
  $("volume-facts").textContent = facts(volume);
  forgetPick();
  refresh();
  grid.show(`/v1/volumes/${volume.id}`);
}

async function listVolumes() {
  const listed = await (await request("/v1/volumes")).json();
  volumes = listed.volumes;
  $("volume").replaceChildren(
    ...volumes.map(({ id, dims, hu_range: hu }) => option(id, `${dims.join(" × ")}${DOT}${hu[0]} to ${hu[1]} HU`)),
  );
  $("volume-field").hidden = volumes.length < 2;
  if (state.volume) $("volume").value = state.volume.id;
  return listed.loading;
}

/** Waits for the first volume, and for those still on their way. */
async function awaitVolumes(wanted) {
  for (;;) {
    const loading = await listVolumes();
    if (!state.volume && volumes.length) {
      const first = volumes.find((volume) => volume.id === wanted) ?? volumes[0];
      if (first) $("notice").hidden = true;
      showVolume(first);
    }
    if (!loading) break;
    if (!volumes.length) $("timing").textContent = "loading the series …";
    await new Promise((resolve) => setTimeout(resolve, 700));
  }
  if (!volumes.length) {
    $("timing").textContent = "no volume";
    notify("No volume is loaded. Drop the zip of a CT series here, or start the server with --series.");
  }
}

async function start() {
  const known = await (await request("/v1/presets")).json();
  presets = known.presets;
  grid.fill(presets);
  $("layout").replaceChildren(...known.layouts.map((name) => option(name)));
  fillLights(known.lights);
  $("depth-rule").replaceChildren(...known.depth_rules.map((name) => option(name)));
  $("depth-filter").replaceChildren(...known.depth_filters.map((name) => option(name)));
  $("profile").append(...known.profiles.map((name) => option(name)));
  const wanted = recall();
  describeHeader();
  describePose();
  await awaitVolumes(wanted);
  const ready = await (await request("/readyz")).json();
  $("adapter").textContent = ready.adapter;
  $("adapter").title = ready.adapter;
}

let resizeTimer = 0;
new ResizeObserver(() => {
  clearTimeout(resizeTimer);
  resizeTimer = setTimeout(refresh, 120);
}).observe(stage);

start().catch(showFailure);
