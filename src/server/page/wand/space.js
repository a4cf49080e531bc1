// The pose of the phone in space, where the browser has WebXR: over https, on phones with ARCore.
//
// Positions are metres in the axes of the phone at the start: x right, y up, z towards the user. The
// orientation is that of the phone: x right, y to its top edge, z out of its screen.

/** Whether this browser and this phone can do it. */
export async function canTrack() {
  try {
    return Boolean(await navigator.xr?.isSessionSupported("immersive-ar"));
  } catch {
    return false;
  }
}

/**
 * Begins to track, with `overlay` over the camera's picture; needs a tap. Calls back with every pose, `null` while the phone does
 * not know where it is, and once at the end. Returns a function that ends it.
 */
export async function track(overlay, follow, ended) {
  const session = await navigator.xr.requestSession("immersive-ar", {
    requiredFeatures: ["local", "dom-overlay"], domOverlay: { root: overlay },
  });
  session.addEventListener("end", ended);
  const context = document.createElement("canvas").getContext("webgl", { xrCompatible: true });
  await session.updateRenderState({ baseLayer: new XRWebGLLayer(session, context) });
  const space = await session.requestReferenceSpace("local");
  const step = (_, frame) => {
    session.requestAnimationFrame(step);
    const transform = frame.getViewerPose(space)?.transform;
    if (!transform) return follow(null);
    const { orientation: { x, y, z, w }, position } = transform;
    follow({ orientation: [x, y, z, w], position: [position.x, position.y, position.z] });
  };
  session.requestAnimationFrame(step);
  return () => session.end();
}
