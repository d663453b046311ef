// Keyboard shortcuts; keys of the focused control are left to it.

const TURNS = { ArrowLeft: [0.12, 0], ArrowRight: [-0.12, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };

/** Calls the action of a pressed key, and `touch` after it. */
export function listenToKeys(actions, camera, touch) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const typing = event.target.matches("input:not([type=range], [type=checkbox]), select");
    // A focused button or checkbox handles its own keys.
    const own = event.target.matches("button, summary, input[type=checkbox]") && [" ", "Enter"].includes(event.key);
    const sliding = event.target.matches("input[type=range]") && event.key.startsWith("Arrow");
    if (typing || own || sliding) return;
    const turn = event.shiftKey && TURNS[event.key];
    const action = turn ? () => camera.orbit(...turn) : actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
    touch();
  });
}
