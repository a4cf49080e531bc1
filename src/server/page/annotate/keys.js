// The keyboard: tools, the cursor, placing, items, undo. Fields and dialogs keep their own keys.

import { KEY_TOOLS } from "./tools.js";
import { pointsOf } from "./geometry.js";

const ARROWS = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** `page` has the model, panes, hand, list, guide and the commands of the page. */
export function onKeys(page) {
  const { model, hand, list } = page;
  const chosen = () => model.entry(model.selected);

  const inPane = (event) => {
    const pane = page.panes.find(({ root }) => root === document.activeElement);
    if (!pane) return false;
    const arrow = ARROWS[event.key];
    if (arrow) pane.step(...arrow.map((value) => value * (event.shiftKey ? 5 : 1)), event.ctrlKey);
    else if (event.key === "PageUp" || event.key === "PageDown") pane.page((event.key === "PageUp" ? 1 : -1) * (event.shiftKey ? 5 : 1));
    else if (event.key === "Enter") Promise.resolve(hand.enter(event.ctrlKey)).catch(page.fail);
    else if (event.key === "+" || event.key === "=") pane.zoom(1.2);
    else if (event.key === "-") pane.zoom(1 / 1.2);
    else if (event.key === "Home") pane.home();
    else if (event.key.toLowerCase() === "z") pane.enlarge();
    else if (event.key === " " && pane.cine) pane.cine.toggle();
    else return false;
    return true;
  };

  const onItem = (key) => {
    const entry = chosen();
    if (!entry) return false;
    if (key === "delete") page.remove(entry);
    else if (key === "f2") list.rename(entry.item.id);
    else if (key === "d") page.details(entry);
    else if (key === "h") page.change(entry, { visible: !entry.item.visible });
    else if (key === "k") page.change(entry, { locked: !entry.item.locked });
    else if (key === "," || key === ".") {
      const count = pointsOf(entry.item.geometry).length;
      if (count) model.select(entry.item.id, (model.handle + (key === "." ? 1 : count - 1)) % count);
    } else return false;
    return true;
  };

  const command = (key) => {
    if (KEY_TOOLS[key]) model.chooseTool(KEY_TOOLS[key]);
    else if (/^[1-5]$/.test(key)) page.panes[Number(key) - 1]?.root.focus();
    else if (key === "s" && model.guide) page.guide.skip().catch(page.fail);
    else if (key === "[" || key === "]") list.step(key === "]" ? 1 : -1);
    else if (key === "g") page.log.toggle();
    else if (key === "i") page.chooseFiles();
    else if (key === "x") page.export();
    else if (key === "?") page.help();
    else return false;
    return true;
  };

  const broken = () => {
    if (page.job.cancel() || hand.cancel()) return;
    if (!page.log.host.hidden) return page.log.toggle();
    if (model.tool !== "navigate") return model.chooseTool("navigate");
    model.select(null);
  };

  document.addEventListener("keydown", (event) => {
    if (document.getElementById("dialog").open || event.defaultPrevented) return;
    const key = event.key.toLowerCase();
    const inField = event.target.closest("input:not([type=checkbox]):not([type=color]), select, textarea");
    if ((event.ctrlKey || event.metaKey) && (key === "z" || key === "y") && !inField) {
      event.preventDefault();
      const again = key === "y" || event.shiftKey;
      return again ? page.redo() : hand.placing.takeBack() || page.undo();
    }
    if (event.key === "Escape") return inField ? inField.blur() : broken();
    if (inField || event.metaKey || event.altKey || (event.ctrlKey && event.key !== "Enter" && !ARROWS[event.key])) return;
    if (event.key === "Enter" && event.target.closest("button, summary, a")) return;
    if (event.key === "Backspace" && (hand.placing.takeBack() || hand.removePoint())) return event.preventDefault();
    if (event.key === "Enter" && hand.placing.points.length && ["curve", "contour"].includes(model.tool) && !event.ctrlKey) {
      event.preventDefault();
      return hand.placing.finish().catch(page.fail);
    }
    if (inPane(event) || onItem(key) || command(key)) event.preventDefault();
  });
}
