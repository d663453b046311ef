// `window.umo`, for tests and debugging: the page's state in numbers. Times in seconds, positions in metres, weights 0
// to 1.

export function inspector({ scene, motion, clock, camera, picture, live, takes, last, actions }) {
  const view = document.querySelector("#view");
  return {
    scene,
    live,
    clock,
    /** The score of a take as it is edited: its text, events and the one that is chosen. */
    score: takes?.editor,
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
    /** Number of frames drawn, and the time of the last one. */
    get drawn() {
      const { drawn, time } = last();
      return { count: drawn, time };
    },
    /** Joints of the last drawn frame. */
    joints() {
      const { pose, placed } = last();
      return scene.joints.map((name, i) => ({ name, place: placed.places[i], rotation: pose.rotations[i] }));
    },
    /** Joint positions of each member of a conversation in the last drawn frame. */
    members: () => scene.room.map(({ name }, i) => ({ name, places: last().all[i].placed.places })),
    /** Non-zero morph targets of the last drawn frame. */
    weights: () => picture.figure.weights(last().pose.face),
    /** Position of a joint in the last drawn frame, in CSS pixels from the upper left corner. */
    onScreen(name) {
      const joint = last().placed.places[scene.joints.indexOf(name)];
      return camera.project(joint, view.clientWidth, view.clientHeight);
    },
    /** Raw values of one frame: rotations, root, face. */
    frame: (index) => Array.from(motion.frame(index)),
    /** play, pause, seek (draws at once, including the camera), camera, details, follow (a member, by its number), skeleton, theme. */
    ...actions,
  };
}
