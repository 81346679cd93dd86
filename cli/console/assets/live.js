// Receives a frame from the server and passes it to the scene, the plots and the texts. The return
// value reports to the server that this browser is ready for the next one.
export default {
  template: `<div hidden class="live"></div>`,
  mounted() {
    this.verified = null;
    document.body.dataset.link = "connecting";
    this.waiting = setInterval(() => this.connection(), 500);
  },
  beforeUnmount() {
    clearInterval(this.waiting);
  },
  methods: {
    show(frame) {
      this.came = performance.now();
      const { dataset } = document.body;
      dataset.link = frame.link;
      dataset.state = frame.state;
      dataset.cage = frame.cage_on ? "on" : "off";
      dataset.near = frame.near;
      for (const element of document.querySelectorAll("[data-read]")) {
        const text = frame.read[element.dataset.read] ?? "";
        if (element.textContent !== text) element.textContent = text;
      }
      this.flash(frame.verified);
      window.dispatchEvent(new CustomEvent("quadctl", { detail: frame }));
      return frame.seen;
    },
    // VERIFYING lasts one step of 50 ms: show it long enough to be seen.
    flash(verified) {
      if (this.verified !== null && verified !== this.verified) {
        const box = document.querySelector(".state-VERIFYING");
        box?.classList.remove("flash");
        void box?.getBoundingClientRect(); // restarts the animation
        box?.classList.add("flash");
      }
      this.verified = verified;
    },
    // The console itself may have ended.
    connection() {
      if (this.came && performance.now() - this.came > 3000 && document.body.dataset.link !== "lost") {
        document.body.dataset.link = "lost";
        for (const element of document.querySelectorAll('[data-read="problem"]'))
          element.textContent = "the console has ended, or this browser cannot reach it";
      }
    },
  },
};
