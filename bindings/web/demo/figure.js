// Draws a pose: bones as strokes, the face as an ellipse with brows, lids and a mouth.

const rotate = ([x, y, z, w], [a, b, c]) => {
  const t = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2], c + w * t[2] + x * t[1] - y * t[0]];
};
const multiply = ([ax, ay, az, aw], [bx, by, bz, bw]) => [
  aw * bx + ax * bw + ay * bz - az * by,
  aw * by - ax * bz + ay * bw + az * bx,
  aw * bz + ax * by - ay * bx + az * bw,
  aw * bw - ax * bx - ay * by - az * bz,
];

/** Where the joints are in the avatar's space, and how they are turned. */
export function joints(model, pose) {
  const places = [];
  const turns = [];
  model.parents.forEach((parent, j) => {
    const offset = [...model.offsets.subarray(3 * j, 3 * j + 3)];
    const own = pose.rotations.subarray(4 * j, 4 * j + 4);
    turns.push(parent < 0 ? [...own] : multiply(turns[parent], own));
    const moved = parent < 0 ? offset.map((v, i) => v + pose.translation[i]) : rotate(turns[parent], offset);
    places.push(parent < 0 ? moved : moved.map((v, i) => v + places[parent][i]));
  });
  return { places, turns };
}

export function draw(canvas, model, pose) {
  const ratio = devicePixelRatio;
  const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const g = canvas.getContext("2d");
  g.clearRect(0, 0, width, height);
  const { places, turns } = joints(model, pose);
  const name = (text) => model.jointNames.indexOf(text);
  const head = name("head");
  const floor = Math.min(...places.map(([, y]) => y));
  const scale = (0.84 * height) / (places[head][1] - floor + 0.25);
  const at = ([x, y]) => [width / 2 + (x - places[0][0]) * scale, 0.94 * height - (y - floor) * scale];

  g.strokeStyle = "#8884";
  g.lineWidth = 2 * ratio;
  g.beginPath();
  g.moveTo(0, 0.945 * height);
  g.lineTo(width, 0.945 * height);
  g.stroke();

  g.lineCap = "round";
  model.parents.forEach((parent, j) => {
    const text = model.jointNames[j];
    if (parent < 0 || text === "jaw" || text.endsWith("_eye")) return;
    const isFinger = /index|middle|ring|pinky|thumb/.test(text);
    g.strokeStyle = text.startsWith("left") ? "#3b7ddd" : text.startsWith("right") ? "#d9604a" : "#7a8594";
    g.lineWidth = (isFinger ? 0.012 : 0.05) * scale;
    g.beginPath();
    g.moveTo(...at(places[parent]));
    g.lineTo(...at(places[j]));
    g.stroke();
  });

  const channel = (text) => pose.face[model.channelNames.indexOf(text)] ?? 0;
  // Points of the face in the head's frame, metres.
  const point = (x, y) => at(rotate(turns[head], [x, y + 0.07, 0.09]).map((v, i) => v + places[head][i]));
  const curve = (points, color, size) => {
    g.strokeStyle = color;
    g.lineWidth = size * scale;
    g.beginPath();
    points.forEach(([x, y], i) => g[i ? "lineTo" : "moveTo"](...point(x, y)));
    g.stroke();
  };
  const [x, y] = point(0, 0);
  g.fillStyle = "#e7c3a5";
  g.beginPath();
  g.ellipse(x, y, 0.085 * scale, 0.115 * scale, 0, 0, 7);
  g.fill();
  for (const [side, s] of [["Left", 1], ["Right", -1]]) {
    const open = Math.max(0.001, 0.011 * (1 - channel(`eyeBlink${side}`)));
    const [ex, ey] = point(s * 0.034, 0.025);
    g.fillStyle = "#23303f";
    g.beginPath();
    g.ellipse(ex, ey, 0.011 * scale, open * scale, 0, 0, 7);
    g.fill();
    const [inner, outer] = [channel("browInnerUp"), channel(`browOuterUp${side}`)].map((up) => 0.05 + 0.02 * (up - channel(`browDown${side}`)));
    curve([[s * 0.016, inner], [s * 0.055, outer]], "#5b4636", 0.007);
  }
  const open = 0.03 * channel("jawOpen") + 0.012 * (channel("mouthLowerDownLeft") + channel("mouthUpperUpLeft")) - 0.02 * channel("mouthClose");
  const wide = 0.03 + 0.012 * (channel("mouthSmileLeft") + channel("mouthStretchLeft")) - 0.016 * (channel("mouthPucker") + 0.6 * channel("mouthFunnel"));
  const smile = 0.012 * (channel("mouthSmileLeft") - channel("mouthFrownLeft"));
  const arc = (depth) => Array.from({ length: 13 }, (_, i) => {
    const t = i / 6 - 1;
    return [wide * t, -0.055 + smile * t * t - depth * (1 - t * t)];
  });
  g.fillStyle = "#6d2b2b";
  g.beginPath();
  [...arc(-0.3 * Math.max(0, open)), ...arc(Math.max(0, open)).reverse()].forEach(([px, py], i) => g[i ? "lineTo" : "moveTo"](...point(px, py)));
  g.fill();
  curve(arc(-0.3 * Math.max(0, open)), "#a04a4a", 0.005);
  curve(arc(Math.max(0, open)), "#a04a4a", 0.006);
}
