// The last minute of one value, on a canvas.
const MINUTE = 60;
const AGAIN = 400; // ms between two redraws; in 100 ms the line moves by less than a pixel
const LEFT = 62;
const BOTTOM = 18;
const TOP = 10;

export default {
  template: `
    <figure class="plot">
      <figcaption>{{ title }}<span :data-read="read"></span></figcaption>
      <canvas :aria-label="title + ' over the last minute'" role="img"></canvas>
    </figure>`,
  props: { field: Number, title: String, read: String, since: Number, least: Number },
  mounted() {
    this.samples = [];
    this.canvas = this.$el.querySelector("canvas");
    this.listen = (event) => this.take(event.detail);
    window.addEventListener("quadctl", this.listen);
    this.watch = new ResizeObserver(() => this.draw());
    this.watch.observe(this.canvas);
  },
  beforeUnmount() {
    window.removeEventListener("quadctl", this.listen);
    this.watch.disconnect();
  },
  methods: {
    take(frame) {
      if (frame.fresh) this.samples = [];
      if (!frame.samples.length) return;
      this.samples.push(...frame.samples);
      const newest = this.samples.at(-1);
      const one = (sample) => this.since < 0 || sample[this.since] === newest[this.since];
      this.samples = this.samples.filter((sample) => sample[0] > newest[0] - MINUTE && one(sample));
      if (frame.fresh || performance.now() - this.drawn > AGAIN) this.draw();
    },
    range() {
      const values = this.samples.map((sample) => sample[this.field]).filter((value) => value !== null);
      if (!values.length) return null;
      const low = Math.min(...values);
      const high = Math.max(...values);
      const room = Math.max((high - low) * 0.15, (this.least - (high - low)) / 2);
      return [low - room, high + room];
    },
    draw() {
      this.drawn = performance.now();
      const { clientWidth: width, clientHeight: height } = this.canvas;
      const dots = window.devicePixelRatio || 1;
      this.canvas.width = width * dots;
      this.canvas.height = height * dots;
      const pen = this.canvas.getContext("2d");
      pen.scale(dots, dots);
      const range = this.range();
      if (!range) return;
      const style = getComputedStyle(this.$el);
      const now = this.samples.at(-1)[0];
      const x = (stamp) => LEFT + (1 - (now - stamp) / MINUTE) * (width - LEFT - 4);
      const y = (value) => TOP + ((range[1] - value) / (range[1] - range[0])) * (height - TOP - BOTTOM);
      this.axes(pen, range, width, height, y, style);
      pen.strokeStyle = style.color;
      pen.lineWidth = 1.5;
      pen.lineJoin = "round";
      pen.beginPath();
      let gap = true;
      let last = 0;
      for (const sample of this.samples) {
        const value = sample[this.field];
        // Readings more than 0.5 s apart mean that some are missing: leave a gap.
        if (value === null) gap ||= sample[0] - last > 0.5;
        else {
          pen[gap ? "moveTo" : "lineTo"](x(sample[0]), y(value));
          [gap, last] = [false, sample[0]];
        }
      }
      pen.stroke();
    },
    axes(pen, [low, high], width, height, y, style) {
      const step = this.step((high - low) / 3);
      const digits = Math.min(5, Math.max(0, -Math.floor(Math.log10(step))));
      pen.font = `11px ${style.fontFamily}`;
      pen.fillStyle = style.getPropertyValue("--quiet");
      pen.strokeStyle = style.getPropertyValue("--line");
      pen.lineWidth = 1;
      pen.textAlign = "right";
      pen.textBaseline = "middle";
      for (let value = Math.ceil(low / step) * step; value < high; value += step) {
        const level = Math.round(y(value)) + 0.5;
        pen.beginPath();
        pen.moveTo(LEFT, level);
        pen.lineTo(width - 4, level);
        pen.stroke();
        pen.fillText((value + 0).toFixed(digits), LEFT - 6, level);
      }
      pen.textBaseline = "alphabetic";
      for (const [text, at] of [["-60 s", 0], ["-30 s", 0.5], ["now", 1]]) {
        pen.textAlign = at === 0 ? "left" : at === 1 ? "right" : "center";
        pen.fillText(text, LEFT + at * (width - LEFT - 4), height - 4);
      }
    },
    // Rounds up to 1, 2 or 5 times a power of ten.
    step(rough) {
      const power = 10 ** Math.floor(Math.log10(rough));
      return power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999);
    },
  },
};
