// Pairing of a phone: the QR code of the page that makes it a wand for this view.

const $ = (id) => document.getElementById(id);
/** Size of a module on the canvas, pixels, and the quiet zone around the code, modules (ISO/IEC 18004). */
const MODULE_PX = 5;
const QUIET = 4;

/** Shows the code for a view, with what to do. */
export async function showPairing(view) {
  const answer = await fetch(`/v1/session/wand?${new URLSearchParams({ view })}`, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ view, origin: location.origin }),
  });
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.detail);
  draw($("wand-code"), found.rows);
  $("wand-pairing").hidden = false;
  $("wand-words").textContent = words(new URL(found.url), found.expires_in_s);
  $("wand-address").href = found.url;
  $("wand-pairing").scrollIntoView();
}

function words({ hostname, protocol }, seconds) {
  if (["localhost", "127.0.0.1", "[::1]"].includes(hostname)) {
    return "Other machines cannot reach this address. Open this page by the server's own name or address.";
  }
  const sensors = protocol === "https:" ? "" : " Browsers give a page without https no sensors: the phone is then a touch pad.";
  return `Scan the code with a phone within ${seconds} s.${sensors}`;
}

function draw(canvas, rows) {
  canvas.width = canvas.height = (rows.length + 2 * QUIET) * MODULE_PX;
  const context = canvas.getContext("2d");
  context.fillStyle = "#fff";
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.fillStyle = "#000";
  rows.forEach((row, y) => {
    [...row].forEach((module, x) => {
      if (module === "1") context.fillRect((x + QUIET) * MODULE_PX, (y + QUIET) * MODULE_PX, MODULE_PX, MODULE_PX);
    });
  });
}
