// The tool rail and the parts of the chosen tool: its hint, its fields, the snap.

import { fewestPoints, pointsOf } from "./geometry.js";
import { element } from "./pane.js";

const $ = (id) => document.getElementById(id);

/** Name, key, icon, what it does, and what to do with it. */
const TOOLS = [
  ["navigate", "V", "Look", '<path d="M5 3.500 15.500 9l-4.600 1.500L8.500 15z"/>', "Click: the cursor goes there. Drag: turn in 3D, take the cursor along in slices. Nothing is changed."],
  ["edit", "E", "Edit", '<path d="M7 9V5.200a1.200 1.200 0 0 1 2.400 0V9m0-.800a1.200 1.200 0 0 1 2.400 0V10m0-.600a1.200 1.200 0 0 1 2.400 0v3.100a4 4 0 0 1-4 4h-1c-2 0-3-1.200-4-3L4.500 11.500c.600-.800 1.500-.600 2.500.500V9"/>', "Press on a point and drag it; let go to keep it, Escape to leave it. On the line of the chosen curve a press adds a point."],
  null,
  ["point", "P", "Point", '<circle cx="10" cy="10" r="5"/><circle cx="10" cy="10" r=".8" fill="currentColor"/>', "Press for a preview, let go to set it. Escape breaks off."],
  ["line", "L", "Line", '<path d="M5.500 14.500l9-9"/><circle cx="4.500" cy="15.500" r="1.500"/><circle cx="15.500" cy="4.500" r="1.500"/>', "Set both ends, in any view."],
  ["angle", "A", "Angle", '<path d="M16.500 15.500H4L13 5"/><path d="M9.500 15.500a5.500 5.500 0 0 0-2-4"/>', "Set the end of one arm, the corner, the end of the other."],
  ["curve", "C", "Curve", '<path d="M3.500 13.500c4-12 6 6 13-7"/>', "Set points along it; Enter or a double click ends it."],
  ["contour", "O", "Contour", '<path d="M10 4c4.500 0 7 2 6.500 6s-3 6-7.500 6-6-4-5-7.500S6.500 4 10 4z"/>', "Set points around it; a click on the first one, Enter or a double click closes it."],
  ["plane", "N", "Plane", '<path d="M3 13.500 7.500 6H17l-4.500 7.500zM10 9.800V4"/>', "Set three points: the first two along its width."],
  null,
  ["grow", "R", "Grow a region", '<path d="M6.500 5c4-3 9-1 9.500 3s-2 8-6.500 8S3 13.500 3.500 10 5 6 6.500 5z" fill="currentColor" fill-opacity=".3"/><path d="M10 8v4M8 10h4"/>', "Press on the structure."],
  ["paint", "B", "Paint", '<circle cx="11.500" cy="8" r="5" fill="currentColor" fill-opacity=".3"/><path d="M8 12l-4.500 4.500"/>', "Click: a sphere of the chosen region, or of a new one."],
];

export const KEY_TOOLS = Object.fromEntries(TOOLS.filter(Boolean).map(([name, key]) => [key.toLowerCase(), name]));

export class Tools {
  constructor(model, { finish, removePoint }) {
    this.model = model;
    const buttons = TOOLS.map((tool) => {
      if (!tool) return element("hr");
      const [name, key, title, drawing] = tool;
      const button = element("button", { type: "button", className: "icon", title: `${title} (${key})`, ariaLabel: title, onclick: () => model.chooseTool(name) });
      button.innerHTML = `<svg viewBox="0 0 20 20" aria-hidden="true">${drawing}</svg>`;
      button.dataset.tool = name;
      button.setAttribute("aria-keyshortcuts", key);
      return button;
    });
    $("tools").replaceChildren(...buttons);
    $("tools").addEventListener("keydown", (event) => this.#roam(event));
    $("options").addEventListener("submit", (event) => event.preventDefault());
    $("finish").addEventListener("click", finish);
    $("remove-point").addEventListener("click", removePoint);
    for (const id of ["snap-to", "snap-radius", "snap-hu"]) $(id).addEventListener("input", () => this.#snap());
    model.on("tool guide", () => this.draw());
    model.on("tool selection items", () => this.#points());
    this.#snap();
    this.draw();
    this.#points();
  }

  /** A toolbar is one stop of the Tab key; arrows go on from there. */
  #roam(event) {
    const by = { ArrowDown: 1, ArrowUp: -1, ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    const buttons = [...$("tools").querySelectorAll("button")];
    const at = buttons.indexOf(document.activeElement);
    buttons[(at + by + buttons.length) % buttons.length].focus();
  }

  #snap() {
    const [radius, hu] = [Number($("snap-radius").value), Number($("snap-hu").value)];
    this.model.snap = { to: $("snap-to").value, radius_mm: radius > 0 ? Math.min(50, radius) : 5, hu };
    for (const part of document.querySelectorAll(".snapping")) part.hidden = this.model.snap.to === "off";
    for (const part of document.querySelectorAll(".of-surface")) part.hidden = this.model.snap.to !== "surface";
  }

  /** The actions on the points of the chosen item. */
  #points() {
    const item = this.model.entry(this.model.selected)?.item;
    $("remove-point").hidden = item?.geometry?.kind !== "curve";
    $("remove-point").disabled = !item || item.locked || pointsOf(item.geometry).length <= fewestPoints(item.geometry);
  }

  draw() {
    const { tool } = this.model;
    document.body.dataset.tool = tool;
    for (const button of $("tools").querySelectorAll("button")) {
      const on = button.dataset.tool === tool;
      button.setAttribute("aria-pressed", String(on));
      button.tabIndex = on ? 0 : -1;
    }
    for (const group of document.querySelectorAll(".group-of")) group.hidden = !group.dataset.for.split(" ").includes(tool);
    const [, , title, , hint] = TOOLS.find((known) => known?.[0] === tool);
    const expected = this.model.expected?.(tool)?.item.name;
    $("hint").replaceChildren(element("b", {}, title), expected ? ` “${expected}”: ${hint}` : ` ${hint}`);
    $("hint").title = hint;
  }
}
