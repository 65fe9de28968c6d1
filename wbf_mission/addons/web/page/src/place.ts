// Parser of geographic positions in common notations.

/** Limit of the map's projection. */
const MOST_LATITUDE_DEG = 85;
const EXAMPLES = `write latitude and longitude, such as 28.0599, -82.138 or 28°3'35.6"N 82°8'16.8"W`;
const SPELLINGS: [RegExp, string][] = [
  [/[−–—]/g, "-"],
  [/[′’‘ʹ´`]/g, "'"],
  [/[″“”„]|''/g, '"'],
  [/[º˚]/g, "°"],
  [/^geo:|[:=()]|\u00a0/gi, " "],
  [/(lat(itude)?)(?![a-z])/gi, "Y"],
  [/(lon(g|gitude)?|lng)(?![a-z])/gi, "X"],
  [/(degrees?|deg|d)(?![a-z])/gi, "°"],
  [/(minutes?|min)(?![a-z])/gi, "'"],
  [/(seconds?|sec)(?![a-z])/gi, '"'],
  [/([nsew])(orth|outh|ast|est)(?![a-z])/gi, "$1"],
];
/** A number or a mark; any other text is found without a group. */
const TOKEN = /([+-]?\d+(?:\.\d+)?|[°'"NSEWXY,;])|\S/g;
const UNITS = [["°", 1], ["'", 60], ['"', 3600]] as const;

class Unread extends Error {}

/** Read a latitude and longitude, or return a one-line error. */
export function placeOf(text: string): [number, number] | string {
  try {
    return read(text);
  } catch (error) {
    if (!(error instanceof Unread)) throw error;
    return `“${text.trim().slice(0, 60)}” is no place: ${error.message}; ${EXAMPLES}`;
  }
}

function read(text: string): [number, number] {
  const [before, after] = halves(tokensOf(text));
  const [first, second] = [angleOf(before), angleOf(after)];
  const axis = first.axis ?? (second.axis === "lat" ? "lon" : "lat");
  if (first.axis !== null && first.axis === second.axis) throw new Unread(`it has two ${NAMES[first.axis]}s`);
  const [lat, lon] = axis === "lat" ? [first.value, second.value] : [second.value, first.value];
  if (Math.abs(lat) > 90) throw new Unread(`latitude ${lat} is beyond 90°; latitude comes first`);
  if (Math.abs(lat) > MOST_LATITUDE_DEG) throw new Unread(`the map ends at latitude ${MOST_LATITUDE_DEG}°`);
  if (Math.abs(lon) > 180) throw new Unread(`longitude ${lon} is beyond 180°`);
  return [lat, lon];
}

function tokensOf(text: string): string[] {
  let plain = SPELLINGS.reduce((known, [spelling, mark]) => known.replace(spelling, mark), text).toUpperCase();
  if (!/\d\.\d/.test(plain)) {
    // Without a decimal point, a comma between digits is a decimal comma.
    if (/\d,\d+,\d/.test(plain)) throw new Unread("its commas may be decimal or separate numbers; write decimal points");
    plain = plain.replace(/(\d),(?=\d)/g, "$1.");
  }
  return [...plain.matchAll(TOKEN)].map(({ 1: token, index }) => {
    if (token === undefined) throw new Unread(`“${plain.slice(index).trim().slice(0, 12)}” is not understood`);
    return token;
  });
}

const isNumber = (token: string | undefined): boolean => token !== undefined && /\d/.test(token);
const isLetter = (token: string | undefined): boolean => token !== undefined && /[A-Z]/.test(token);

/** Split the tokens into two angles. */
function halves(tokens: string[]): [string[], string[]] {
  for (const border of bordersOf(tokens)) {
    const [before, after] = [tokens.slice(0, border), tokens.slice(border)];
    if (/[,;]/.test(after[0] ?? "")) after.shift();
    if (before.some(isNumber) && after.some(isNumber)) return [before, after];
  }
  throw new Unread(tokens.filter(isNumber).length === 1 ? "longitude is missing" : "it needs two angles of the same form");
}

/** Possible start positions of the second angle, the most certain first. */
function bordersOf(tokens: string[]): number[] {
  const places = (is: (token: string) => boolean): number[] => tokens.flatMap((token, k) => (is(token) ? [k] : []));
  const separators = places((token) => /[,;]/.test(token));
  if (separators.length) return separators.slice(0, 1);
  const [axes, letters] = [places((token) => /[XY]/.test(token)), places((token) => /[NSEW]/.test(token))];
  const [degrees, numbers] = [places((token) => token === "°"), places(isNumber)];
  const found = axes.slice(1);
  if (letters.length) found.push(...(letters[0] === 0 ? letters.slice(1) : [letters[0]! + 1]));
  if (degrees.length === 2) found.push(degrees[1]! - 1);
  if (numbers.length % 2 === 0) found.push(numbers[numbers.length / 2] ?? 0);
  return found;
}

const AXES: Record<string, "lat" | "lon"> = { N: "lat", S: "lat", Y: "lat", E: "lon", W: "lon", X: "lon" };
const NAMES = { lat: "latitude", lon: "longitude" };

/** Angle from degrees, minutes and seconds, with a hemisphere or a sign. */
function angleOf(tokens: string[]): { value: number; axis: "lat" | "lon" | null } {
  const letters = tokens.filter(isLetter);
  const [begin, end] = [tokens.findIndex((token) => !isLetter(token)), tokens.findLastIndex((token) => !isLetter(token))];
  const parts = tokens.slice(begin, end + 1);
  const axes = new Set(letters.map((letter) => AXES[letter]!));
  const sides = letters.filter((letter) => /[NSEW]/.test(letter));
  if (parts.some(isLetter) || axes.size > 1 || sides.length > 1) throw new Unread("it has a misplaced or second direction (N, S, E, W)");
  if (parts.some((part) => /[,;]/.test(part))) throw new Unread("it has more than two angles");
  let [value, place] = [0, 0];
  for (let k = 0; k < parts.length; place++) {
    const text = parts[k++]!;
    if (place > 2 || !isNumber(text)) throw new Unread(`“${text}” is at a wrong place`);
    if (parts[k] !== undefined && !isNumber(parts[k]) && parts[k++] !== UNITS[place]?.[0])
      throw new Unread(`degrees, minutes (') and seconds (") follow each other`);
    if (place && (/[+-]/.test(text) || Number(text) >= 60)) throw new Unread(`minutes and seconds are 0 to 60, not ${text}`);
    if (k < parts.length && text.includes(".")) throw new Unread(`${text} has decimals before further numbers`);
    value += Math.abs(Number(text)) / UNITS[place]![1];
  }
  const signed = /^[+-]/.test(parts[0] ?? "");
  if (signed && sides.length) throw new Unread("it has a sign and a direction");
  const negative = signed ? parts[0]!.startsWith("-") : /[SW]/.test(sides[0] ?? "");
  return { value: negative ? -value : value, axis: [...axes][0] ?? null };
}
