// `window.umo`, for tests and the curious: what is shown, in numbers. Times in seconds, places in metres, weights 0 to 1.

export function inspector({ scene, motion, clock, camera, picture, live, last, actions }) {
  const view = document.querySelector("#view");
  return {
    scene,
    live,
    clock,
    get time() {
      return clock.time;
    },
    get seconds() {
      return clock.seconds;
    },
    get frames() {
      return motion.end;
    },
    get playing() {
      return clock.playing;
    },
    /** How many pictures were drawn, and the time of the last. */
    get drawn() {
      const { drawn, time } = last();
      return { count: drawn, time };
    },
    /** The last picture's joints. */
    joints() {
      const { pose, placed } = last();
      return scene.joints.map((name, i) => ({ name, place: placed.places[i], rotation: pose.rotations[i] }));
    },
    /** The last picture's morph targets that are not at 0. */
    weights: () => picture.figure.weights(last().pose.face),
    /** Where a joint is in the last picture, CSS pixels from the picture's upper left corner. */
    onScreen(name) {
      const joint = last().placed.places[scene.joints.indexOf(name)];
      return camera.project(joint, view.clientWidth, view.clientHeight);
    },
    /** The values of one frame as they came: rotations, root, face. */
    frame: (index) => Array.from(motion.frame(index)),
    /** play, pause, seek (draws at once, camera and all), camera, details, skeleton, theme. */
    ...actions,
  };
}
