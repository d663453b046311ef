// The keyboard: what is for a control that has the focus is left to it.

const TURNS = { ArrowLeft: [0.12, 0], ArrowRight: [-0.12, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };

/** Calls the action of a key that is pressed, and `touch` after it. */
export function listenToKeys(actions, camera, touch) {
  const help = document.querySelector("#help");
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || help.open) return;
    const typing = event.target.matches("input[type=search], select");
    // Where a button or a box has the focus, its own keys are its own.
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
