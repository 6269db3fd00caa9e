"use strict";
const live = document.getElementById("live");
const note = document.getElementById("note");
const said = document.getElementById("said");
const token = document.getElementById("token");
let heard = Date.now(), timer;

// Makes `old` equal to `now` and touches only what differs. Elements with a key move, so that pictures are not loaded
// again; an opened log stays open.
function morph(old, now) {
  if (old.isEqualNode(now)) return;
  if (old.nodeType !== 1 || old.nodeName !== now.nodeName) return old.replaceWith(now);
  for (const { name } of [...old.attributes])
    if (name !== "open" && !now.hasAttribute(name)) old.removeAttribute(name);
  for (const { name, value } of now.attributes)
    if (old.getAttribute(name) !== value) old.setAttribute(name, value);
  const key = (node) => node?.dataset?.key;
  const keyed = new Map([...old.children].filter(key).map((child) => [key(child), child]));
  let at = old.firstChild;
  for (const child of [...now.childNodes]) {
    const same = key(child) ? keyed.get(key(child)) : at && !key(at) ? at : null;
    keyed.delete(key(child));
    if (!same) { old.insertBefore(child, at); continue; }
    if (same === at) at = at.nextSibling; else old.insertBefore(same, at);
    morph(same, child);
  }
  while (at) { const next = at.nextSibling; at.remove(); at = next; }
}

// The server draws the page; its new numbers are put into this one.
async function refresh() {
  clearTimeout(timer);
  try {
    const answer = await fetch("/", { cache: "no-store", signal: AbortSignal.timeout(10000) });
    if (!answer.ok) throw new Error(answer.status);
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    morph(live, page.getElementById("live"));
    document.title = page.title;
    heard = Date.now();
    note.hidden = true;
  } catch {
    note.textContent = `No answer from the coordinator for ${Math.round((Date.now() - heard) / 1000)} s: ` +
      "this is how things were then. It ends by itself when the run is finished.";
    note.hidden = false;
  }
  timer = setTimeout(refresh, 2000);
}
timer = setTimeout(refresh, 2000);

document.addEventListener("click", async (event) => {
  const button = event.target.closest("button[data-post]");
  if (!button || (button.dataset.ask && !confirm(button.dataset.ask))) return;
  if (!token.value) { said.textContent = "first the token"; return token.focus(); }
  try {
    const headers = { Authorization: `Bearer ${token.value}` };
    const answer = await fetch(button.dataset.post, { method: "POST", headers });
    said.textContent = `${button.textContent}: ${(await answer.text()).trim()}`;
  } catch (error) {
    said.textContent = `${button.textContent}: ${error.message}`;
  }
  refresh();
});
