// The vehicle in its cage, and the others, redrawn only after a change.
import { CSS2DRenderer, OrbitControls, THREE } from "nicegui-scene";
import { COLOURS, column, cross, mark, others, place, room, spread, vehicle } from "quadctl-shapes";

const KEPT = 600;
const STILL = 5; // px; a pointer that moves less between down and up has clicked

export default {
  template: `<div class="scene" tabindex="0" role="application" aria-label="The vehicle in its cage, from the south">
    <canvas></canvas><div class="labels"></div><p class="without" hidden>No 3-D view: this browser has no WebGL.</p></div>`,
  props: { height: Number, control: Boolean, keys: Array },
  emits: ["floor", "step", "send", "drop"],
  watch: { height: "hover" },
  mounted() {
    this.listen = (event) => this.take(event.detail);
    this.press = (event) => this.key(event);
    window.addEventListener("keydown", this.press);
    if (!this.begin()) {
      this.$el.querySelector(".without").hidden = false;
      return;
    }
    window.addEventListener("quadctl", this.listen);
    this.resized = new ResizeObserver(() => this.fit());
    this.resized.observe(this.$el);
    const draw = () => {
      this.next = requestAnimationFrame(draw);
      if (!this.changed) return;
      this.changed = false;
      this.renderer.render(this.world, this.camera);
      this.texts.render(this.world, this.camera);
    };
    draw();
  },
  beforeUnmount() {
    cancelAnimationFrame(this.next);
    window.removeEventListener("keydown", this.press);
    window.removeEventListener("quadctl", this.listen);
    this.resized?.disconnect();
    this.renderer?.dispose();
  },
  methods: {
    begin() {
      const canvas = this.$el.querySelector("canvas");
      try {
        this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
      } catch {
        return false;
      }
      this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
      this.texts = new CSS2DRenderer({ element: this.$el.querySelector(".labels") });
      const world = (this.world = new THREE.Scene());
      world.add(new THREE.AmbientLight(0xffffff, 1.9));
      const sun = new THREE.DirectionalLight(0xffffff, 1.6);
      sun.position.set(-4, -6, 12);
      world.add(sun);
      this.vehicle = vehicle();
      this.shadow = new THREE.Mesh(new THREE.CircleGeometry(0.3, 32), new THREE.MeshBasicMaterial({ color: "#000", transparent: true, opacity: 0.16 }));
      this.goal = mark(COLOURS.goal, 0.1);
      this.aim = mark(COLOURS.aim, 0.12);
      this.ghost = mark(COLOURS.aim, 0.07, 0.45);
      this.trail = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: COLOURS.trail, transparent: true, opacity: 0.7 }));
      this.trail.frustumCulled = false;
      this.path = [];
      this.refused = new THREE.Group();
      this.others = others();
      this.zones = [];
      for (const part of [this.vehicle, this.shadow, this.goal, this.aim, this.ghost]) part.visible = false;
      world.add(this.vehicle, this.shadow, this.goal, this.aim, this.ghost, this.trail, this.refused, this.others);
      this.camera = new THREE.PerspectiveCamera(38, 1, 0.1, 500);
      this.camera.up.set(0, 0, 1);
      this.controls = new OrbitControls(this.camera, canvas);
      this.controls.maxPolarAngle = 1.52;
      this.controls.addEventListener("start", () => (this.turned = true));
      this.controls.addEventListener("change", () => (this.changed = true));
      canvas.addEventListener("pointerdown", (event) => (this.down = [event.clientX, event.clientY]));
      canvas.addEventListener("pointerup", (event) => this.click(event));
      canvas.addEventListener("pointermove", (event) => this.hover(event));
      canvas.addEventListener("pointerleave", () => this.hover(null));
      return true;
    },
    take(frame) {
      const told = JSON.stringify([frame.cage, frame.cage_on, frame.pose, frame.goal, frame.target, frame.refused, frame.zones, frame.others]);
      if (frame.fresh) this.path = [];
      if (!frame.fresh && told === this.told) return;
      this.told = told;
      this.changed = true;
      this.zones = frame.zones ?? this.zones; // sent after a change
      if (frame.others) spread(this.others, frame.others);
      if (frame.cage) this.build(frame.cage, frame.cage_on);
      if (frame.pose) {
        const [x, y, z, ...turn] = frame.pose;
        this.vehicle.visible = this.shadow.visible = true;
        this.vehicle.position.set(x, y, z + 0.03);
        this.vehicle.quaternion.set(...turn);
        this.shadow.position.set(x, y, 0.006);
      }
      place(this.goal, frame.state === "MOVING" ? frame.goal : null);
      place(this.aim, frame.target);
      this.path.push(...frame.samples.map((sample) => new THREE.Vector3(...sample.slice(1, 4))));
      this.path.splice(0, this.path.length - KEPT);
      this.trail.geometry.dispose();
      this.trail.geometry = new THREE.BufferGeometry().setFromPoints(this.path);
      this.cross(frame.refused);
    },
    cross(refused) {
      while (this.refused.children.length < refused.length) this.refused.add(cross());
      this.refused.children.forEach((child, index) => {
        child.visible = index < refused.length;
        if (!child.visible) return;
        child.position.set(...refused[index]);
        child.userData.foot.scale.z = Math.max(Math.abs(refused[index][2]), 0.001);
      });
    },
    // Rebuilds the floor, the cage and the zones after a change of the cage or the zones.
    build(cage, on) {
      const said = `${cage} ${on}`;
      if (said === this.built && this.zones === this.drawn) return;
      if (!this.built) this.look(cage);
      [this.built, this.drawn] = [said, this.zones];
      this.room?.traverse((part) => {
        part.element?.remove();
        part.geometry?.dispose();
        part.material?.dispose();
      });
      if (this.room) this.world.remove(this.room);
      this.room = room(cage, on);
      this.room.add(...this.zones.map((zone) => column(zone, cage, on)));
      this.world.add(this.room);
    },
    look([x, y, z]) {
      this.cage = [x, y, z];
      this.controls.target.set(0, 0, z * 0.3);
      const from = new THREE.Vector3(0.3, -1, 0.62).normalize();
      // Moves the camera back until all corners are in view, with some room around them.
      for (let far = Math.max(x, y, z); far < 1e5; far *= 1.04) {
        this.camera.position.copy(this.controls.target).addScaledVector(from, far);
        this.controls.update();
        this.camera.updateMatrixWorld();
        const inside = [-x, x].every((a) => [-y, y].every((b) => [0, z].every((c) => this.sees(a, b, c))));
        if (inside) break;
      }
      const far = this.camera.position.length();
      [this.camera.near, this.camera.far] = [Math.max(0.1, far / 2000), Math.max(500, 4 * far)];
      this.camera.updateProjectionMatrix();
    },
    sees(x, y, z) {
      const at = new THREE.Vector3(x, y, z).project(this.camera);
      return Math.max(Math.abs(at.x), Math.abs(at.y)) < 0.88;
    },
    fit() {
      const { clientWidth: width, clientHeight: height } = this.$el;
      if (!width || !height) return;
      this.renderer.setSize(width, height, false);
      this.texts.setSize(width, height);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      // Keep the user's view once it has been turned.
      if (this.cage && !this.turned) this.look(this.cage);
      this.changed = true;
    },
    floor(event) {
      const box = this.$el.getBoundingClientRect();
      const at = new THREE.Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
      const ray = new THREE.Raycaster();
      ray.setFromCamera(at, this.camera);
      return ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), 0), new THREE.Vector3());
    },
    click(event) {
      const [x, y] = this.down ?? [Infinity, Infinity];
      const still = Math.hypot(event.clientX - x, event.clientY - y) < STILL;
      this.down = null;
      const at = still && event.button === 0 && this.floor(event);
      if (at) this.$emit("floor", { x: at.x, y: at.y });
    },
    hover(event) {
      if (!this.control || !this.world) return;
      if (event === null) this.over = null;
      else if (event instanceof Event) this.over = event.buttons || event.pointerType === "touch" ? null : this.floor(event);
      place(this.ghost, this.over ? [this.over.x, this.over.y, this.height] : null);
      this.changed = true;
    },
    key(event) {
      if (!this.control || event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.target.closest?.("input, textarea, [role=slider], [role=tab], [role=listbox], [role=combobox]")) return;
      if (this.keys.includes(event.key)) this.$emit("step", event.key);
      else if (event.key === "Enter" && !event.target.closest?.("button, a, [role=switch], [role=checkbox]")) this.$emit("send");
      else if (event.key === "Escape") this.$emit("drop");
      else return;
      event.preventDefault();
    },
    // Returns the pixels of a point (m) on the page.
    where(x, y, z) {
      const box = this.$el.getBoundingClientRect();
      const at = new THREE.Vector3(x, y, z).project(this.camera);
      return [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
    },
  },
};
