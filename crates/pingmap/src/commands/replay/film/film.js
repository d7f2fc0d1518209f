'use strict';
// Plays the film of a mission. The page holds its data as JSON; data.rs describes the fields.

const FRAME_MS = 700;
const UNKNOWN = 128;
const STEPS = 127;
const HALO = 'rgba(0, 0, 0, .65)';

const film = JSON.parse(document.getElementById('film-data').textContent);
const { area, moments, messages, vehicles, viewers } = film;
const [canvas, slider, select, button, status, more, here, bar] =
  ['map', 'time', 'viewer', 'play', 'status', 'more', 'here', 'bar'].map(name => document.getElementById('film-' + name));
const pen = canvas.getContext('2d');
const colors = film.colors.map(digits => parseInt(digits, 16));
const width_m = area.east[1] - area.east[0], height_m = area.north[1] - area.north[0];
const tracks = vehicles.map((_, vehicle) => track(vehicle));

let timer = null;      // Runs while the film plays.
let pointed = null;    // Position in metres that the reader points at.
let size = [1, 1];     // Width and height of the map in CSS pixels.

// The state that the page shows.
const now = () => Number(slider.value);
const moment = () => moments[now()];
const viewer = () => viewers[select.selectedIndex];
const map = () => moment().maps[select.selectedIndex];

// ---- Data ----

/** Returns the positions of a vehicle in the order of time, from the messages that it sent or listened for. */
function track(vehicle) {
  const fixes = [];
  for (const [time, from, to, sent, listened] of messages) {
    if (from === vehicle) fixes.push([time, ...sent]);
    if (to === vehicle) fixes.push([time, ...listened]);
  }
  return fixes;
}

/** Returns the bytes of the cells, in rows from the south. */
const bytes = digits => Uint8Array.from(digits.match(/../g), pair => parseInt(pair, 16));

/** Returns the messages after the previous moment and up to this one. */
function recentMessages() {
  const since = now() > 0 ? moments[now() - 1].time_s : -Infinity;
  return messages.filter(([time]) => time > since && time <= moment().time_s);
}

// ---- Words ----

const percent = share => Math.round(100 * share) + ' %';
const count = (number, noun) => `${number} ${noun}${number === 1 ? '' : 's'}`;

/** Returns the time since the first moment in hours, minutes and seconds. */
function elapsed() {
  const seconds = Math.round(moment().time_s - moments[0].time_s);
  const two = number => String(number).padStart(2, '0');
  return `${Math.floor(seconds / 3600)}:${two(Math.floor(seconds / 60) % 60)}:${two(seconds % 60)}`;
}

/** Returns the log, the time, the vehicle and its events. */
function statement() {
  const { own, received, packets } = map();
  const events = count(own + received, 'event');
  const summaries = packets > 0 ? ` It also uses ${count(packets, 'summary packet')}.` : '';
  return `${film.log}, ${elapsed()} after the first event (${moment().words}): ${vehicles[viewer()].name} knows ` +
    `${events}, ${own} of its own and ${received} from others.${summaries}`;
}

/** Returns a summary of the map and of the recent messages. */
function summary() {
  const values = [...bytes(map().cells)];
  const share = holds => percent(values.filter(holds).length / values.length);
  const heard = recentMessages().filter(message => message[5]).length;
  const missed = recentMessages().length - heard;
  return `A message is more likely received than missed in ${share(value => (value & STEPS) > STEPS / 2)} of the area. ` +
    `${share(value => value & UNKNOWN)} of the area is not known. ` +
    `Since the time before: ${count(heard, 'message')} heard, ${missed} missed.`;
}

/** Returns the prediction where the reader points. */
function reading() {
  if (!pointed) return here.textContent;
  const [east, north] = pointed;
  const column = Math.min(area.columns - 1, Math.floor((east - area.east[0]) / width_m * area.columns));
  const row = Math.min(area.rows - 1, Math.floor((north - area.north[0]) / height_m * area.rows));
  const value = bytes(map().cells)[row * area.columns + column];
  const unknown = value & UNKNOWN ? ', not known' : '';
  return `${Math.round(east)} m east, ${Math.round(north)} m north: ${percent((value & STEPS) / STEPS)}${unknown}`;
}

// ---- Drawing ----

const pixel = ([east, north]) =>
  [(east - area.east[0]) / width_m * size[0], (area.north[1] - north) / height_m * size[1]];

function line(points, color, width, dash = []) {
  pen.setLineDash(dash);
  pen.strokeStyle = color;
  pen.lineWidth = width;
  pen.beginPath();
  points.map(pixel).forEach(([x, y], n) => (n ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
  pen.setLineDash([]);
}

/** Draws a white path with a dark edge. */
function outlined(path, width) {
  for (const [style, wide] of [[HALO, width + 2.5], ['#fff', width]]) {
    pen.strokeStyle = pen.fillStyle = style;
    pen.lineWidth = wide;
    pen.stroke(path);
  }
}

/** Writes letters that are readable on every colour. */
function letters(text, x, y, align = 'left') {
  pen.font = '13px sans-serif';
  pen.textAlign = align;
  pen.textBaseline = 'middle';
  pen.lineJoin = 'round';
  pen.lineWidth = 4;
  pen.strokeStyle = HALO;
  pen.strokeText(text, x, y);
  pen.fillStyle = '#fff';
  pen.fillText(text, x, y);
}

/** Fits the canvas to the page. */
function fit() {
  const width = canvas.clientWidth;
  size = [width, width * height_m / width_m];
  const ratio = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = size.map(side => Math.round(side * ratio));
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
}

/** Draws the probabilities, interpolated between the centres of the cells. */
function drawProbabilities(values) {
  const image = new ImageData(area.columns, area.rows);
  values.forEach((value, cell) => {
    const row = area.rows - 1 - Math.floor(cell / area.columns);
    const color = colors[value & STEPS];
    image.data.set([color >> 16, (color >> 8) & 255, color & 255, 255], 4 * (row * area.columns + cell % area.columns));
  });
  const small = Object.assign(document.createElement('canvas'), { width: area.columns, height: area.rows });
  small.getContext('2d').putImageData(image, 0, 0);
  pen.imageSmoothingEnabled = true;
  pen.drawImage(small, 0, 0, ...size);
}

/** Hatches the cells that are not known. */
function hatch(values) {
  pen.save();
  pen.beginPath();
  const [wide, high] = [size[0] / area.columns, size[1] / area.rows];
  values.forEach((value, cell) => {
    const row = area.rows - 1 - Math.floor(cell / area.columns);
    if (value & UNKNOWN) pen.rect(cell % area.columns * wide, row * high, wide, high);
  });
  pen.clip();
  pen.beginPath();
  for (let x = 0; x < size[0] + size[1]; x += 9) {
    pen.moveTo(x, 0);
    pen.lineTo(x - size[1], size[1]);
  }
  pen.strokeStyle = 'rgba(255, 255, 255, .5)';
  pen.lineWidth = 1;
  pen.stroke();
  pen.restore();
}

/** Draws the tracks until now. */
function drawTracks() {
  tracks.forEach((fixes, vehicle) => {
    const past = fixes.filter(([time]) => time <= moment().time_s).map(([, ...place]) => place);
    const points = [...past, moment().places[vehicle]];
    line(points, 'rgba(255, 255, 255, .8)', 4);
    line(points, vehicles[vehicle].color, 2, vehicles[vehicle].dash);
  });
}

/** Draws a message as a line with a disc or a cross at the receiver; pale if the chosen vehicle did not send it. */
function drawMessage([, from, , sent, listened, heard]) {
  pen.globalAlpha = from === viewer() ? 1 : 0.5;
  line([sent, listened], HALO, 2.5, heard ? [] : [4, 4]);
  line([sent, listened], '#fff', 1.2, heard ? [] : [4, 4]);
  pen.globalAlpha = 1;
  const [x, y] = pixel(listened);
  const mark = new Path2D(heard ? '' : `M${x - 5} ${y - 5}l10 10M${x - 5} ${y + 5}l10 -10`);
  if (heard) mark.arc(x, y, 4, 0, 2 * Math.PI);
  outlined(mark, heard ? 1 : 2);
  if (heard) pen.fill(mark);
}

/** Draws the vehicles with their names, and a ring around the chosen one. */
function drawVehicles() {
  moment().places.forEach((place, vehicle) => {
    const [x, y] = pixel(place);
    const { name, color } = vehicles[vehicle];
    for (const radius of vehicle === viewer() ? [10, 5] : [5]) {
      const circle = new Path2D();
      circle.arc(x, y, radius, 0, 2 * Math.PI);
      outlined(circle, 2.5);
      pen.fillStyle = color;
      if (radius === 5) pen.fill(circle);
    }
    const isRight = x > 0.7 * size[0];
    letters(name, x + (isRight ? -15 : 15), Math.max(10, y - 12), isRight ? 'right' : 'left');
  });
}

/** Draws a scale bar over a round number of metres, and the direction of north. */
function drawScale() {
  const wanted = width_m / 6, power = 10 ** Math.floor(Math.log10(wanted));
  const metres = [5, 2, 1].map(step => step * power).find(step => step <= wanted);
  const length = metres / width_m * size[0], y = size[1] - 12;
  outlined(new Path2D(`M12 ${y}H${12 + length}`), 2.5);
  letters(metres < 1000 ? `${metres} m` : `${metres / 1000} km`, 12 + length / 2, y - 13, 'center');
  letters('↑ N', 12, 16);
}

function draw() {
  const values = bytes(map().cells);
  drawProbabilities(values);
  hatch(values);
  drawTracks();
  // Crosses lie over discs.
  for (const heard of [true, false]) recentMessages().filter(message => message[5] === heard).forEach(drawMessage);
  drawVehicles();
  drawScale();
}

/** Shows the chosen moment and vehicle, as a picture and in words. */
function show() {
  draw();
  const text = statement();
  status.textContent = text;
  more.textContent = summary();
  here.textContent = reading();
  canvas.setAttribute('aria-label', `Map. ${text} ${more.textContent}`);
  slider.setAttribute('aria-valuetext', `${elapsed()} after the first event`);
}

// ---- Control ----

function pause() {
  clearInterval(timer);
  timer = null;
  button.textContent = 'Play';
  status.setAttribute('aria-live', 'polite');
}

function play() {
  if (now() === moments.length - 1) slider.value = 0;
  // A screen reader does not read every frame.
  status.setAttribute('aria-live', 'off');
  button.textContent = 'Pause';
  timer = setInterval(advance, FRAME_MS);
  show();
}

function advance() {
  slider.value = now() + 1;
  if (now() === moments.length - 1) pause();
  show();
}

const toggle = () => (timer === null ? play() : pause());

function step(places) {
  pause();
  slider.value = now() + places;
  show();
}

/** Handles keys outside the controls, which have keys of their own. */
function pressed(event) {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest('.scroll, select')) return;
  const places = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (event.key === ' ' && event.target !== button) toggle();
  else if (places && event.target !== slider) step(places);
  else return;
  event.preventDefault();
}

function point(event) {
  const box = canvas.getBoundingClientRect();
  const share = (position, low, length) => Math.min(1, Math.max(0, (position - low) / length));
  const across = share(event.clientX, box.left, box.width), down = share(event.clientY, box.top, box.height);
  pointed = [area.east[0] + across * width_m, area.north[1] - down * height_m];
  here.textContent = reading();
}

slider.max = moments.length - 1;
canvas.style.aspectRatio = `${width_m} / ${height_m}`;
canvas.style.maxWidth = `${78 * width_m / height_m}vh`;
viewers.forEach(vehicle => select.add(new Option(vehicles[vehicle].name)));
bar.style.background = `linear-gradient(to right, ${film.colors.map(digits => '#' + digits).join(', ')})`;
slider.addEventListener('input', () => step(0));
select.addEventListener('change', show);
button.addEventListener('click', toggle);
document.addEventListener('keydown', pressed);
for (const kind of ['pointerdown', 'pointermove']) canvas.addEventListener(kind, point);
new ResizeObserver(() => { fit(); draw(); }).observe(canvas);
fit();
show();
if (!matchMedia('(prefers-reduced-motion: reduce)').matches) play();
