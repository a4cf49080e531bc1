// A screen in space that shows the views of both eyes, where the browser has WebXR: headsets, and
// glasses-free displays whose drivers track eyes.
//
// Positions are metres in the space of the session: x right, y up, z towards the viewer. The screen
// stands upright before the viewer, in the direction and at the height of the first pose. Poses of
// the eyes are those that the browser predicts for the next picture; the views are made for them.

/** Whether this browser can show views to both eyes. */
export async function canImmerse() {
  try {
    return Boolean(await navigator.xr?.isSessionSupported("immersive-vr"));
  } catch {
    return false;
  }
}

const VERTEX = `#version 300 es
uniform mat4 clipFromView;
uniform mat4 viewFromSpace;
uniform mat4 spaceFromScreen;
// Half the width and half the height of the screen, m.
uniform vec2 half_;
// The eye's part of the picture: where it begins and how wide it is, as shares of the width.
uniform vec2 part;
out vec2 at;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  at = vec2(part.x + corner.x * part.y, 1.0 - corner.y);
  gl_Position = clipFromView * viewFromSpace * spaceFromScreen * vec4((2.0 * corner - 1.0) * half_, 0, 1);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D picture;
in vec2 at;
out vec4 color;
void main() { color = vec4(texture(picture, at).rgb, 1); }`;

/** Where the screen stands: `distance` m before a pose, upright, facing it; a matrix by columns. */
function screenBefore({ position, orientation: { x, y, z, w } }, distance) {
  // The direction of sight is -z of the pose; on the floor it is the heading.
  const sight = [-2 * (x * z + w * y), -(1 - 2 * (x * x + y * y))];
  const length = Math.hypot(...sight) || 1;
  const [right, away] = [sight[0] / length, sight[1] / length];
  return new Float32Array([
    -away, 0, right, 0,
    0, 1, 0, 0,
    -right, 0, -away, 0,
    position.x + right * distance, position.y, position.z + away * distance, 1,
  ]);
}

/** A point of the session's space, in mm in the space of the screen. */
function onScreen(screen, { x, y, z }) {
  const way = [x - screen[12], y - screen[13], z - screen[14]];
  return [0, 4, 8].map((column) => 1000 * (way[0] * screen[column] + way[1] * screen[column + 1] + way[2] * screen[column + 2]));
}

class Renderer {
  #gl;
  #places;

  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { xrCompatible: true, alpha: false, antialias: true });
    if (!gl) throw new Error("this browser has no WebGL2, which a screen in space needs");
    this.#gl = gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`the shader of the screen in space: ${gl.getProgramInfoLog(program)}`);
    gl.useProgram(program);
    const names = ["clipFromView", "viewFromSpace", "spaceFromScreen", "half_", "part"];
    this.#places = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
    gl.bindVertexArray(gl.createVertexArray());
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.LINEAR);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
  }

  get context() {
    return this.#gl;
  }

  take(picture) {
    const gl = this.#gl;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
  }

  begin(framebuffer) {
    const gl = this.#gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  draw({ x, y, width, height }, view, screen, half, part) {
    const gl = this.#gl;
    gl.viewport(x, y, width, height);
    gl.uniformMatrix4fv(this.#places.clipFromView, false, view.projectionMatrix);
    gl.uniformMatrix4fv(this.#places.viewFromSpace, false, view.transform.inverse.matrix);
    gl.uniformMatrix4fv(this.#places.spaceFromScreen, false, screen);
    gl.uniform2f(this.#places.half_, ...half);
    gl.uniform2f(this.#places.part, ...part);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }
}

/**
 * Shows the picture of `panel` (both views side by side) on a screen of `width` m, `distance` m before the viewer. Calls `follow`
 * with the eyes of every pose, mm in the space of the screen, and `ended` at the end. Returns a function that ends it.
 */
export async function immerse({ panel, width, distance, follow, ended }) {
  const session = await navigator.xr.requestSession("immersive-vr");
  session.addEventListener("end", ended);
  try {
    await begin(session, { panel, width, distance, follow });
  } catch (error) {
    session.end();
    throw error;
  }
  return () => session.end();
}

async function begin(session, { panel, width, distance, follow }) {
  const renderer = new Renderer(document.createElement("canvas"));
  const layer = new XRWebGLLayer(session, renderer.context);
  await session.updateRenderState({ baseLayer: layer });
  const space = await session.requestReferenceSpace("local");
  let screen = null;
  const step = (_, frame) => {
    session.requestAnimationFrame(step);
    const pose = frame.getViewerPose(space);
    if (!pose) return;
    screen ??= screenBefore(pose.transform, distance);
    const eyes = Object.fromEntries(pose.views.map((view) => [view.eye, onScreen(screen, view.transform.position)]));
    const { left, right } = eyes;
    // Behind the screen there is nothing to see.
    if (left?.[2] > 0 && right?.[2] > 0) follow({ left_mm: left, right_mm: right });
    renderer.take(panel);
    renderer.begin(layer.framebuffer);
    const half = [width / 2, (width / 2) * (panel.height / (panel.width / 2))];
    for (const view of pose.views) {
      const part = view.eye === "right" ? [0.5, 0.5] : [0, 0.5];
      renderer.draw(layer.getViewport(view), view, screen, half, part);
    }
  };
  session.requestAnimationFrame(step);
}
