// The displayed series: its name, the warnings of its reader, and the choice of another one where the series of a link is
// missing. Shared by the page of the volume and the page for annotations.

/** Digits of a volume's id that are displayed. */
const ID_DIGITS = 8;

/** The name of a volume and the beginning of its content hash, which no other volume has. */
export const identityOf = ({ name, id }) => `${name} · ${id.slice(0, ID_DIGITS)}`;

/** Lists the warnings of a volume's reader in a `details` element. Closed, it still has their number. */
export function showWarnings(details, { id, warnings, reading_warnings: kinds }) {
  if (details.dataset.volume !== id) Object.assign(details, { open: warnings > 0, hidden: warnings === 0 });
  details.dataset.volume = id;
  const count = `${warnings} warning${warnings === 1 ? "" : "s"} on reading`;
  details.querySelector("summary").textContent = count;
  const line = ({ text, count }) => {
    const item = document.createElement("li");
    item.textContent = count > 1 ? `${text} (${count} times)` : text;
    return item;
  };
  details.querySelector("ul").replaceChildren(...kinds.map(line));
}

/** Fills the section for a link whose series is missing: a button for each volume. Calls `choose` with the chosen one. */
export function offerOthers(section, volumes, choose) {
  const known = volumes.map(({ id }) => id).join();
  if (section.dataset.known === known && !section.hidden) return;
  section.dataset.known = known;
  section.hidden = false;
  const button = (volume) => {
    const made = Object.assign(document.createElement("button"), { type: "button", textContent: identityOf(volume) });
    made.addEventListener("click", () => {
      section.hidden = true;
      choose(volume);
    });
    return made;
  };
  section.querySelector(".choices").replaceChildren(...volumes.map(button));
  section.querySelector(".none").hidden = volumes.length > 0;
}
