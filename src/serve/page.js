"use strict";
const live = document.getElementById("live");
const note = document.getElementById("note");
const ask = document.getElementById("ask");
let heard = Date.now(), timer;

// Makes `old` equal to `now` by changing only the differences. Elements with a key move, so that pictures are not
// loaded again; an opened log stays open.
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

// The server draws the page; the script copies the new content into this one.
async function refresh() {
  clearTimeout(timer);
  try {
    const answer = await fetch("/live", { cache: "no-store", signal: AbortSignal.timeout(10000) });
    if (!answer.ok) throw new Error(answer.status);
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    morph(live, page.getElementById("live"));
    document.title = page.title;
    heard = Date.now();
    note.hidden = true;
  } catch {
    note.textContent = `The coordinator has not answered for ${Math.round((Date.now() - heard) / 1000)} s. ` +
      "The page shows the last known state. A coordinator exits when its run is finished.";
    note.hidden = false;
  }
  timer = setTimeout(refresh, 2000);
}
timer = setTimeout(refresh, 2000);

// The dialog exists only if the server has a token.
if (ask) {
  const part = (id) => document.getElementById(id);
  let target;
  const act = async () => {
    try {
      const headers = { Authorization: `Bearer ${part("token").value}` };
      const answer = await fetch(target, { method: "POST", headers });
      if (!answer.ok) throw new Error((await answer.text()).trim());
      ask.close();
      refresh();
    } catch (error) {
      part("refusal").textContent = error.message;
    }
  };
  document.addEventListener("click", ({ target: clicked }) => {
    const button = clicked.closest("button[data-post]");
    if (!button) return;
    target = button.dataset.post;
    part("question").textContent = button.dataset.ask;
    part("refusal").textContent = "";
    ask.showModal();
    part("token").focus();
  });
  part("token").addEventListener("keydown", ({ key }) => { if (key === "Enter") act(); });
  part("go").addEventListener("click", act);
  part("leave").addEventListener("click", () => ask.close());
}
