// Trials of the page to judge: a motion with its own speech and with another's, the answers, and their counts.

/** Numbers from 0 to 1 by a seed of 32 bits: Marsaglia's xorshift. */
function randomBy(seed) {
  let x = seed || 1;
  return () => {
    x ^= x << 13;
    x ^= x >>> 17;
    x ^= x << 5;
    return (x >>> 0) / 2 ** 32;
  };
}

/** All pieces of all takes: the take, and the number of the piece in the take and on the page. */
function piecesOf({ takes }) {
  return takes.flatMap(({ pieces }, take) => Array.from({ length: pieces }, (_, part) => ({ take, part }))).map((piece, index) => ({ ...piece, index }));
}

/** One trial per piece, in random order: a piece of motion, the speech of another take, and whether its own is A. */
export function trialsOf(judge, seed) {
  const random = randomBy(seed);
  // The first numbers of similar seeds are similar.
  for (let i = 0; i < 20; i++) random();
  const pick = (list) => list[Math.floor(random() * list.length)];
  const pieces = piecesOf(judge);
  const trials = pieces.map((piece) => {
    const others = pieces.filter(({ take }) => take !== piece.take);
    // From the same time of the other recording if it is so long: beginnings are heard against beginnings.
    const alike = others.filter(({ part }) => part === piece.part);
    return { piece, other: pick(alike.length > 0 ? alike : others), isOwnA: random() < 0.5 };
  });
  for (let i = trials.length - 1; i > 0; i--) {
    const j = Math.floor(random() * (i + 1));
    [trials[i], trials[j]] = [trials[j], trials[i]];
  }
  return trials;
}

/** 1 for the right speech, 0 for the wrong one; a tie is half of each. */
const shareOf = ({ own, answer }) => (answer === "equal" ? 0.5 : Number(answer === own));

/** Counts of answers: the share of right ones, and Wilson's interval of 95 %. */
export function count(answers) {
  const pairs = answers.length;
  const of = (value) => answers.filter((answer) => shareOf(answer) === value).length;
  const share = answers.reduce((sum, answer) => sum + shareOf(answer), 0) / pairs;
  const [z, weight] = [1.96, 1 + 1.96 ** 2 / pairs];
  const middle = (share + z ** 2 / (2 * pairs)) / weight;
  const half = (z / weight) * Math.sqrt((share * (1 - share)) / pairs + z ** 2 / (4 * pairs ** 2));
  return { pairs, right: of(1), equal: of(0.5), wrong: of(0), share, low: Math.max(middle - half, 0), high: Math.min(middle + half, 1) };
}

/** Answers by whether the face was shown. */
export const byFace = (answers) => Object.fromEntries(["hidden", "shown"].map((face) => [face, answers.filter((one) => one.face === face)]).filter(([, some]) => some.length > 0));

export function jsonOf({ about, seed, seconds, answers }) {
  const results = Object.fromEntries(Object.entries(byFace(answers)).map(([face, some]) => [face, count(some)]));
  return JSON.stringify({ about, seed, seconds, results, answers }, null, 1);
}

/** A header, then a line per answer. */
export function csvOf({ seed, answers }) {
  const cell = (value) => (/[",\n]/.test(value) ? `"${String(value).replaceAll('"', '""')}"` : String(value));
  const rows = answers.map((answer) => [seed, ...Object.values(answer)]);
  return [["seed", ...Object.keys(answers[0] ?? {})], ...rows].map((row) => `${row.map(cell).join()}\n`).join("");
}
