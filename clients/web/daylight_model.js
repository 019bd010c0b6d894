// Daylight without the page: dates, units, false colour and the sun's path. Pure functions; place: status.place (PROTOCOL.md).

import { luminance } from './probe_geometry.js';

export const EFFICACY = 179; // lm/W: cd/m2 per W sr^-1 m^-2 of white

const MONTHS = ['January', 'February', 'March', 'April', 'May', 'June', 'July', 'August', 'September', 'October', 'November', 'December'];
export const MONTH_DAYS = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];

// Day of the year, 1 to 365, as "21 March".
export function dayText(day) {
  let [month, left] = [0, day];
  while (month < 11 && left > MONTH_DAYS[month]) left -= MONTH_DAYS[month++];
  return `${left} ${MONTHS[month]}`;
}

// Candelas per square metre, or lux of an irradiance, per image unit; stops: of the scale of the sky, a setting.
export const perUnit = (place, stops = 0) => EFFICACY / (place.units * 2 ** stops);

// The colours of the server's false colour, at equal distances, and the exposed luminances of its ends.
const STOPS = [[18, 12, 60], [42, 42, 134], [24, 96, 172], [18, 146, 160], [62, 184, 110], [160, 212, 60], [248, 222, 60], [246, 150, 46], [206, 44, 44]];
export const FALSE_COLOUR = 'false-colour';
const [LEAST, MOST] = [0.01, 10];

export function falseColour(share) {
  const at = 8 * Math.min(1, Math.max(0, share));
  const k = Math.min(7, Math.floor(at));
  return `rgb(${STOPS[k].map((c, i) => Math.round(c + (at - k) * (STOPS[k + 1][i] - c))).join(', ')})`;
}

// Labels of the false colour's legend from its lower to its upper end: [share, value in the image's unit times `unit`].
export function legend(gain, unit) {
  const [low, high] = [LEAST, MOST].map((v) => (v / gain) * unit);
  const marks = [];
  for (let decade = Math.floor(Math.log10(low)); decade <= Math.log10(high); decade++)
    for (const digit of [1, 2, 5]) {
      const value = digit * 10 ** decade;
      if (value >= low * 0.999 && value <= high * 1.001) marks.push([Math.log(value / low) / Math.log(high / low), value]);
    }
  return marks;
}

// Two or three significant digits, with thousands apart: "0.32", "45", "12 300".
export function amount(value) {
  if (!Number.isFinite(value)) return '–';
  if (value === 0) return '0';
  const rounded = Number(value.toPrecision(3));
  return rounded >= 10000 ? String(rounded).replace(/\B(?=(\d{3})+$)/g, '\u202f') : String(rounded);
}

// The illuminance in lux of the matte surface that a probe answer shows, per radiance of the pixel; null: it is not matte.
// E = pi L / albedo, with both as luminances.
export function illuminanceFactor(answer) {
  const lobe = answer?.point?.lobe;
  if (answer?.sees !== 'surface' || !lobe || lobe.specular || !(luminance(lobe.diffuse) > 0)) return null;
  return Math.PI / luminance(lobe.diffuse);
}

// Elevation and azimuth (from north over east) of the sun in degrees [Spencer 1971]. hour: local standard time.
export function sunAt({ latitude, longitude, zone }, day, hour) {
  const g = (2 * Math.PI * (day - 1 + 1.15 + (hour - 12) / 24)) / 365; // as server/sky/daylight/sun.c
  const declination = 0.006918 - 0.399912 * Math.cos(g) + 0.070257 * Math.sin(g) - 0.006758 * Math.cos(2 * g)
    + 0.000907 * Math.sin(2 * g) - 0.002697 * Math.cos(3 * g) + 0.00148 * Math.sin(3 * g);
  const minutes = 229.18 * (0.000075 + 0.001868 * Math.cos(g) - 0.032077 * Math.sin(g) - 0.014615 * Math.cos(2 * g) - 0.04089 * Math.sin(2 * g));
  const turn = ((hour + longitude / 15 - zone + minutes / 60 - 12) * Math.PI) / 12;
  const north = (latitude * Math.PI) / 180;
  const up = Math.sin(north) * Math.sin(declination) + Math.cos(north) * Math.cos(declination) * Math.cos(turn);
  const east = -Math.cos(declination) * Math.sin(turn);
  const ahead = Math.sin(declination) * Math.cos(north) - Math.cos(declination) * Math.cos(turn) * Math.sin(north);
  const degrees = 180 / Math.PI;
  return { elevation: Math.asin(up) * degrees, azimuth: (Math.atan2(east, ahead) * degrees + 360) % 360 };
}

// The sun's way on a day, while it is up: [{elevation, azimuth, hour}].
export function sunPath(place, day) {
  const all = [];
  for (let hour = 0; hour <= 24; hour += 0.25) {
    const at = sunAt(place, day, hour);
    if (at.elevation >= 0) all.push({ ...at, hour });
  }
  return all;
}

// What a place of measurement got over the year: the newest value of each day and hour.
export class Year {
  constructor() {
    this.forget();
  }

  forget() {
    this.values = new Map(); // 24 times the day from 0, plus the hour
    this.most = 0;
  }

  add(day, hour, value) {
    this.values.set(24 * (day - 1) + Math.floor(hour), value);
    this.most = Math.max(this.most, value);
  }

  // The upper end of its scale: 1, 2 or 5 times a power of ten.
  get top() {
    if (!(this.most > 0)) return 1;
    const ten = 10 ** Math.floor(Math.log10(this.most));
    return ten * [1, 2, 5, 10].find((digit) => digit * ten >= this.most * 0.999999);
  }
}

// Day and hour of a frame, from those of another; both frames are numbered by their place in the year.
export function placeOfFrame(frame, now) {
  const step = ((now.day - 1) * 24 + now.hour) / (now.frame + 0.5);
  const hours = (frame + 0.5) * step;
  return { day: Math.floor(hours / 24) + 1, hour: hours % 24 };
}
