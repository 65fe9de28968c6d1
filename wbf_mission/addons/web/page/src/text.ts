// Formatting of numbers and times.

/** Hours, minutes and seconds of a whole number of seconds. */
function parts(whole: number): [number, number, number] {
  return [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
}

export function clock(time_s: number): string {
  const [hours, minutes, seconds] = parts(Math.max(0, Math.floor(time_s)));
  const two = (n: number): string => String(n).padStart(2, "0");
  return hours ? `${hours}:${two(minutes)}:${two(seconds)}` : `${minutes}:${two(seconds)}`;
}

/** Duration in its two largest units. */
export function duration(time_s: number): string {
  const [hours, minutes, seconds] = parts(Math.round(time_s));
  if (hours) return `${hours} h ${minutes} min`;
  return minutes ? `${minutes} min ${seconds} s` : `${seconds} s`;
}

/** Number with a fixed count of decimals, without a sign on zero. */
export function fixed(value: number, digits: number): string {
  return value.toFixed(digits).replace(/^-(?=[0.]+$)/, "");
}

/** Number with about three significant digits. */
export function figure(value: number): string {
  const size = Math.abs(value);
  if (size !== 0 && size < 0.001) return value.toExponential(1);
  return value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}

export function percent(part: number | null | undefined): string {
  if (part === null || part === undefined) return "–";
  return `${(100 * part).toFixed(part !== 0 && part < 0.02 ? 1 : 0)}\u00a0%`;
}

export function metres(length_m: number): string {
  return length_m >= 1000 ? `${(length_m / 1000).toFixed(2)} km` : `${length_m.toFixed(length_m < 10 ? 1 : 0)} m`;
}

export function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
