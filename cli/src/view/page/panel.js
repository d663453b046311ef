// The panel of a live stream: where the sound comes from, and how far the picture is behind it.

const milliseconds = (seconds) => (seconds === null || seconds === undefined ? "–" : `${(1000 * seconds).toFixed(seconds < 0.1 ? 1 : 0)} ms`);

export function livePanel(element, { scene, motion, live, $ }) {
  element.hidden = false;
  const recording = element.querySelector("#recording");
  const mouth = element.querySelector("#microphone");
  const stop = element.querySelector("#stop");
  recording.hidden = scene.samples.length === 0;
  const begin = (source) => live.start(source).catch((error) => live.fail(sayMicrophone(error)));
  recording.addEventListener("click", () => begin("recording"));
  mouth.addEventListener("click", () => begin("microphone"));
  stop.addEventListener("click", () => live.stop());
  live.toggle = () => (live.isRunning || live.clock.playing ? stopAll(live) : begin(recording.hidden ? "microphone" : "recording"));
  live.ends = (time) => {
    const over = live.log.done && live.clock.playing && time >= motion.seconds - 1 / motion.rate;
    if (over) live.clock.pause();
    return over;
  };
  const set = (id, words) => {
    element.querySelector(id).textContent = words;
  };
  return {
    show() {
      const { started, status, received, late, error, done } = live.log;
      stop.disabled = !live.isRunning;
      recording.disabled = mouth.disabled = live.isRunning;
      const body = milliseconds(started?.bodySeconds ?? scene.live.algorithmicSeconds);
      set("#algorithmic", started?.live ? `${milliseconds(started.mouthSeconds)} mouth, ${body} body` : body);
      set("#compute", status ? `${milliseconds(status.computeP50)} / ${milliseconds(status.computeP99)} / ${milliseconds(status.computeMax)}` : "–");
      set("#arrival", milliseconds(live.arrival()));
      set("#behind", milliseconds(live.behind()));
      set("#received", `${received}${late > 0 ? `, ${late} times late` : ""}`);
      set("#silenced", status ? String(status.overruns) : "–");
      $("#state").textContent = error ?? (live.isRunning ? "live" : done ? "ended" : "ready");
      $("#state").dataset.kind = error ? "error" : live.isRunning ? "live" : "quiet";
    },
  };
}

function stopAll(live) {
  live.log.done = false;
  live.stop();
}

function sayMicrophone(error) {
  const reasons = { NotAllowedError: "the microphone was refused", NotFoundError: "there is no microphone" };
  return reasons[error.name] ?? `the microphone does not open: ${error.message}`;
}
