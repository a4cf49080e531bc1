// Makes the views of a live frame on the graphics card (WebGL2), in the arrangement of an output.
//
// Parallax as the server's crate `display` has it (src/display/views/parallax.rs). Shifts are whole
// numbers of 1/4096 pixel to the right.

import { eyesOf, screenOf, trackedEyes } from "./outputs.js";
import { BLOCK_PX, FLATS, FRAGMENT, SPANS, VERTEX } from "./view-shader.js";

const UNIT = 4096;
const EYE_SEPARATION_MM = 65;
const USUAL_FACTOR = 64;
/** Farthest place of an eye that is followed, in eye separations. */
const MOST_EYES = 16;
/** Texture units, in this order. */
const TEXTURES = ["frontColor", "frontDepth", "backColor", "backDepth", "shifts", "frontSpans", "backSpans", "flats", "given"];

/** Rounds half away from zero, as the server does. */
const rounded = (value) => Math.sign(value) * Math.floor(Math.abs(value) + 0.5);

/** How far each disparity moves for an eye, of a picture of this width; even numbers. */
function shiftsOf(eye, width, { m, screenWidthMm }, [, factor, offset]) {
  const separation = ((width * EYE_SEPARATION_MM) / screenWidthMm) * (factor / USUAL_FACTOR);
  return Int32Array.from({ length: 256 }, (_, d) => {
    const shift = Math.max(-width, Math.min(width, (eye * separation * (d - offset)) / m));
    return 2 * rounded((shift * UNIT) / 2);
  });
}

export class Synthesis {
  #gl;
  #spans;
  #flats;
  #frame;
  #target;
  #textures;
  /** The inputs of the shifts and of the textures of intervals. */
  #shifts = "";
  #size = "";
  #reach = 1;
  /** Size, number of layers and header values of the picture that was taken last. */
  #picture = null;
  /** Whether rendered views are shown in place of those of the picture. */
  #isGiven = false;

  /** `output` is the result of `outputOf`; `profile` names a display. Draws on `canvas`. Throws where there is no WebGL2. */
  constructor(output, profile, canvas = document.createElement("canvas")) {
    this.output = output;
    this.display = screenOf(output, profile);
    this.output.distance = this.display.distance;
    this.canvas = canvas;
    const gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL2, which outputs of views need; without output= the page shows 2D plus depth");
    this.#gl = gl;
    this.#textures = TEXTURES.map((name, unit) => this.#texture(name, unit));
    this.#spans = this.#program(SPANS);
    this.#flats = this.#program(FLATS);
    this.#frame = this.#program(FRAGMENT);
    this.#target = gl.createFramebuffer();
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.#fillGiven([1, 1], new Uint8Array(4));
    gl.bindVertexArray(gl.createVertexArray());
  }

  /** A program with the places of its uniforms; its textures are bound. */
  #program(fragment) {
    const gl = this.#gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(`the view shader: ${gl.getShaderInfoLog(shader)}`);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`the view shader: ${gl.getProgramInfoLog(program)}`);
    gl.useProgram(program);
    const places = {};
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; i += 1) {
      const { name } = gl.getActiveUniform(program, i);
      places[name] = gl.getUniformLocation(program, name);
      if (TEXTURES.includes(name)) gl.uniform1i(places[name], TEXTURES.indexOf(name));
    }
    return { program, places };
  }

  #texture(name, unit) {
    const gl = this.#gl;
    const texture = gl.createTexture();
    const kind = name.endsWith("Spans") || name === "given" ? gl.TEXTURE_2D_ARRAY : gl.TEXTURE_2D;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(kind, texture);
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(kind, key, gl.NEAREST);
    return texture;
  }

  #fill(name, [width, height], [internal, format, type], values) {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + TEXTURES.indexOf(name));
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, format, type, values);
  }

  /** Rendered views, one above the other. */
  #fillGiven([width, height], pixels) {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + TEXTURES.indexOf("given"));
    const count = pixels.length / (4 * width * height);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA8UI, width, height, count, 0, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE, pixels);
  }

  /** The shifts of all eyes, when they have changed. */
  #prepareShifts(width, display) {
    const eyes = eyesOf(this.output);
    const key = [...eyes, width, ...display].join(" ");
    if (key === this.#shifts) return;
    const gl = this.#gl;
    const tables = eyes.map((eye) => shiftsOf(eye, width, this.display, display));
    const all = new Int32Array(256 * tables.length);
    tables.forEach((table, i) => all.set(table, 256 * i));
    this.#reach = Math.ceil(all.reduce((most, shift) => Math.max(most, Math.abs(shift)), 0) / UNIT);
    this.#fill("shifts", [256, tables.length], [gl.R32I, gl.RED_INTEGER, gl.INT], all);
    this.#shifts = key;
  }

  /** Makes views for the eyes of this viewer from now on. Whether there is a picture, and the output follows a viewer. */
  follow(eyes) {
    const tracked = trackedEyes(this.output, eyes);
    if (tracked) this.#isGiven = false;
    if (tracked) this.output.tracked = tracked.map((eye) => Math.max(-MOST_EYES, Math.min(MOST_EYES, eye)));
    return Boolean(tracked && this.#picture);
  }

  /** Frees the graphics context: a browser has few. */
  end() {
    this.#gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  /** The intervals of all pixels of the layers, in each view. */
  #prepareSpans([width, height], count) {
    const gl = this.#gl;
    const { views } = this.output;
    const size = [width, height, count].join(" ");
    for (const [at, name] of ["frontSpans", "backSpans"].entries()) {
      if (size === this.#size) break;
      gl.activeTexture(gl.TEXTURE0 + TEXTURES.indexOf(name));
      const sides = at < count ? [width, height, views] : [1, 1, 1];
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RG32I, ...sides, 0, gl.RG_INTEGER, gl.INT, null);
    }
    if (size !== this.#size) this.#fill("flats", [Math.ceil(width / BLOCK_PX), height], [gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE], null);
    this.#size = size;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#target);
    gl.useProgram(this.#flats.program);
    gl.uniform1i(this.#flats.places.reach, this.#reach);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.#textures[TEXTURES.indexOf("flats")], 0);
    gl.viewport(0, 0, Math.ceil(width / BLOCK_PX), height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const { program, places } = this.#spans;
    gl.useProgram(program);
    gl.viewport(0, 0, width, height);
    for (let layer = 0; layer < count; layer += 1) {
      const [depths, spans] = [["frontDepth", "frontSpans"], ["backDepth", "backSpans"]][layer].map((name) => TEXTURES.indexOf(name));
      gl.uniform1i(places.depths, depths);
      for (let view = 0; view < views; view += 1) {
        gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, this.#textures[spans], 0, view);
        gl.uniform1i(places.view, view);
        gl.drawArrays(gl.TRIANGLES, 0, 3);
      }
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Takes a picture. `layers` have colour (RGBA, 32 bits) and depth (D) of `size`, front first. */
  take(size, layers, display) {
    const gl = this.#gl;
    this.#picture = { size, count: layers.length, display };
    this.#isGiven = false;
    layers.forEach(({ color, depth }, at) => {
      const bytes = new Uint8Array(color.buffer, color.byteOffset, color.byteLength);
      this.#fill(["frontColor", "backColor"][at], size, [gl.RGBA8UI, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE], bytes);
      this.#fill(["frontDepth", "backDepth"][at], size, [gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE], depth);
    });
    if (layers.length < 2) {
      this.#fill("backColor", [1, 1], [gl.RGBA8UI, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE], new Uint8Array(4));
      this.#fill("backDepth", [1, 1], [gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE], new Uint8Array(1));
    }
  }

  /** Takes rendered views of the picture for the eyes of now (RGBA, one above the other), until the picture or the eyes change. */
  give(pixels) {
    this.#fillGiven(this.#picture.size, new Uint8Array(pixels.buffer, pixels.byteOffset, pixels.byteLength));
    this.#isGiven = true;
  }

  /** The frame of the output for the eyes of now, as a canvas; after `take`. */
  draw() {
    const gl = this.#gl;
    const { size, count, display } = this.#picture;
    const { arrangement, grid, views, lens, isBgr, isSwapped } = this.output;
    const [width, height] = this.output.frame(size, grid);
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    if (!this.#isGiven) {
      this.#prepareShifts(size[0], display);
      this.#prepareSpans(size, count);
    }
    const { program, places } = this.#frame;
    gl.useProgram(program);
    gl.uniform2i(places.sizePx, ...size);
    gl.uniform2i(places.framePx, width, height);
    gl.uniform2i(places.gridPx, ...grid);
    gl.uniform1i(places.hasBack, Number(count > 1));
    gl.uniform1i(places.reach, this.#reach);
    gl.uniform1i(places.arrangement, arrangement);
    gl.uniform1i(places.viewCount, views);
    gl.uniform1i(places.isGiven, Number(this.#isGiven));
    gl.uniform1i(places.isSwapped, Number(isSwapped));
    gl.uniform3f(places.lens, ...lens);
    gl.uniform2i(places.redBlue, isBgr ? 2 : 0, isBgr ? 0 : 2);
    gl.viewport(0, 0, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    return this.canvas;
  }
}
