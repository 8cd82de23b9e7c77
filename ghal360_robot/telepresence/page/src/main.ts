/** The page: its parts put together. What each part is for stands at its head. */

import { degrees, radians, wrap } from "./angles.ts";
import { Control, logIn } from "./control.ts";
import { element, write } from "./dom.ts";
import { Drive } from "./drive.ts";
import { Gaze } from "./gaze.ts";
import { type Banner, Hud, reasons } from "./hud.ts";
import { FloorPlan } from "./map.ts";
import { Panel } from "./panel.ts";
import type { Hello, Quality, Right, Scan, State } from "./protocol.gen.ts";
import { World } from "./scene.ts";
import { Trail } from "./trail.ts";
import { canDecode, type StreamName, Video } from "./video.ts";
import { Headset } from "./xr.ts";

const MAP_MS = 100;
const HUD_MS = 100;
const REFUSED_MS = 4000;
const STATE_STALE_MS = 1000;
/** A device that still sends, but too seldom, is slow. */
const STALE_S = 0.25;
/** How often the robot hears which picture is shown. */
const SHOWN_MS = 40;
/** Samples of each delay that are kept. */
const MEASURED = 2000;

const STREAM_WORDS: Record<StreamName, string> = {
  camera: "the camera's own",
  small: "smaller, for slow links",
  stills: "still pictures",
};

class Page {
  private readonly view = element("view", HTMLElement);
  private readonly gaze = new Gaze(this.view);
  private readonly video = new Video();
  private readonly hud = new Hud();
  private readonly plan = new FloorPlan(element("map", HTMLCanvasElement));
  private readonly trail = new Trail();
  private readonly control = new Control({
    hello: (hello) => this.greeted(hello),
    state: (state) => this.told(state),
    scan: (scan) => this.scanned(scan),
    floor: (floor) => this.plan.load(floor),
    right: (right) => this.righted(right),
    quality: (quality) => (this.quality = quality),
    refused: ({ what, why }) => this.notice(`${what === "operate" ? "not driven" : "refused"}: ${why}`),
  });
  private readonly drive = new Drive(this.control, this.gaze);
  private hello: Hello | undefined;
  private state: State | undefined;
  private stateMs = 0;
  private scan: Scan | undefined;
  private quality: Quality | undefined;
  private trouble = "connecting ...";
  private notices: { words: string; untilMs: number }[] = [];
  private pictureUs = 0;
  private shownMs = 0;
  private mapMs = 0;
  private hudMs = 0;
  private unwound = false;
  private arrow = false;
  private ring = true;
  private allBoxes = false;
  private cueShown: State["cue"] = "none";
  private readonly xr: Headset;
  /** Milliseconds, newest last: from a picture's arrival at the robot to its decoding and drawing; round trips. */
  private readonly meter = { decoded: [] as number[], drawn: [] as number[], roundTrips: [] as number[] };
  /** Of each cue, from the decision to the frame that shows it. */
  private readonly cues: { cue: string; ms: number }[] = [];

  private constructor(
    private readonly world: World,
    headset: (page: Page) => Headset,
    private readonly panel: Panel,
  ) {
    this.xr = headset(this);
    this.drive.heading = () => wrap(this.gaze.yaw - world.baseYaw);
    this.drive.onChange = () => this.hudMs = 0;
    this.control.clock.onRoundTrip = (ms) => this.measure("roundTrips", ms);
    this.video.onDecoded = (captureUs) => {
      if (this.control.clock.known) this.measure("decoded", (this.control.clock.nowUs() - captureUs) / 1000);
    };
    this.control.onLost = () => this.lost();
    this.control.onTrouble = (words, loginNeeded) => this.troubled(words, loginNeeded);
    this.gaze.onZoom = () => this.zoomed();
    world.onTick = (timeMs, elapsedMs) => this.tick(timeMs, elapsedMs);
    this.keys();
    this.buttons();
    this.zoomed();
    setInterval(() => this.slow(), HUD_MS);
  }

  static async open(): Promise<Page> {
    const world = await World.create(element("view", HTMLElement));
    const panel = new Panel(world.front);
    const button = element("vr", HTMLButtonElement);
    const page = new Page(world, (self) => new Headset(world, self.gaze, self.drive, button), panel);
    await page.begin();
    return page;
  }

  /** What tests and the bench look at; nothing of the page itself uses it. */
  get inside(): Record<string, unknown> {
    return {
      yaw: this.gaze.yaw,
      pitch: this.gaze.pitch,
      fovV: this.gaze.fovV,
      fovH: this.gaze.fovH,
      settled: this.gaze.settled,
      heading: this.drive.heading(),
      held: this.drive.held,
      stick: this.drive.stick,
      fps: this.video.rate,
      dropped: this.video.dropped,
      pictureUs: this.pictureUs,
      robotUs: this.control.clock.nowUs(),
      state: this.state,
      quality: this.quality,
      right: this.drive.right,
      conn: this.control.conn,
      mode: this.gaze.mode,
      delays: this.meter.drawn,
      cues: this.cues,
      measured: () => ({ ...this.meter, dropped: this.video.dropped + (this.quality?.dropped ?? 0) }),
      forget: () => this.forget(),
    };
  }

  private forget(): void {
    for (const values of Object.values(this.meter)) values.length = 0;
  }

  private measure(what: keyof typeof this.meter, ms: number): void {
    const values = this.meter[what];
    values.push(ms);
    if (values.length > MEASURED) values.shift();
  }

  private async begin(): Promise<void> {
    const token = new URLSearchParams(location.hash.slice(1)).get("token");
    if (token !== null) {
      history.replaceState(null, "", location.pathname);
      await logIn(token);
    }
    this.control.connect();
  }

  private greeted(hello: Hello): void {
    if (this.hello === undefined) this.showArrow(hello.arrow === "continuous");
    this.hello = hello;
    this.trouble = "";
    this.world.cameraYaw = hello.camera_yaw;
    this.choices(hello);
    this.video.open(hello.conn, element("stream", HTMLSelectElement).value as StreamName);
    this.world.drawScan(undefined, hello.blind);
    element("login", HTMLElement).hidden = true;
  }

  private choices(hello: Hello): void {
    const select = element("stream", HTMLSelectElement);
    const before = select.value;
    const possible = hello.streams.filter((stream) => canDecode || stream === "stills");
    select.replaceChildren(...possible.map((stream) => new Option(STREAM_WORDS[stream], stream)));
    if (possible.includes(before as StreamName)) select.value = before;
  }

  private told(state: State): void {
    const first = this.state === undefined;
    if (state.arm !== this.state?.arm) this.hudMs = 0;
    this.state = state;
    this.stateMs = performance.now();
    this.drive.told(state);
    if (state.pose !== null) this.trail.note(state.t_us, state.pose.yaw);
    this.world.drawBoxes(state.boxes, this.allBoxes);
    if (state.cue !== this.cueShown) {
      this.cueShown = state.cue;
      this.hud.cue(state.cue);
      const cue = state.cue;
      if (!first) {
        requestAnimationFrame(() => this.cues.push({ cue, ms: (this.control.clock.nowUs() - state.cue_us) / 1000 }));
      }
      this.hudMs = 0;
    }
  }

  private scanned(scan: Scan): void {
    this.scan = scan;
    if (this.ring) this.world.drawScan(scan, this.hello?.blind ?? [0, 0]);
  }

  private righted(right: Right): void {
    if (this.drive.right?.yours && !right.yours) {
      this.drive.release();
      this.notice(right.driver === null ? "you do not drive any more" : `${right.driver} drives now`);
    }
    this.drive.right = right;
    this.ask(right);
    this.hudMs = 0;
  }

  /** Somebody asks the driver, or the driver does not answer who asked. */
  private ask(right: Right): void {
    const panel = element("ask", HTMLElement);
    const [yes, no] = [element("ask-yes", HTMLButtonElement), element("ask-no", HTMLButtonElement)];
    if (right.yours && right.asking !== null) {
      write(element("ask-text", HTMLElement), `${right.asking} asks to drive. The robot will stop and has to be armed again.`);
      write(yes, "Hand over");
      write(no, "Keep driving");
      yes.onclick = () => this.control.send({ kind: "lease", wish: "hand_over" });
      no.onclick = () => this.control.send({ kind: "lease", wish: "keep" });
      panel.hidden = false;
    } else if (right.may_take && right.driver !== null) {
      write(element("ask-text", HTMLElement), `${right.driver} does not answer. Take over? The robot stops first.`);
      write(yes, "Take over");
      write(no, "Leave it");
      yes.onclick = () => this.control.send({ kind: "lease", wish: "take" });
      no.onclick = () => this.control.send({ kind: "lease", wish: "release" });
      panel.hidden = false;
    } else panel.hidden = true;
  }

  private lost(): void {
    this.drive.lost();
    this.video.close();
    this.quality = undefined;
    this.state = undefined;
    this.trouble = "no connection: the robot stands still";
    this.hudMs = 0;
  }

  private troubled(words: string, loginNeeded: boolean): void {
    this.trouble = `${words}${loginNeeded ? "" : "; trying again"}`;
    element("login", HTMLElement).hidden = !loginNeeded;
    this.hudMs = 0;
  }

  private notice(words: string): void {
    const untilMs = performance.now() + REFUSED_MS;
    this.notices = [...this.notices.filter((notice) => notice.words !== words), { words, untilMs }].slice(-3);
  }

  /** Every drawn frame, in the browser and in the headset alike. */
  private tick(timeMs: number, elapsedMs: number): void {
    if (this.xr.active) this.xr.step();
    else {
      this.gaze.aspect = this.view.clientWidth / Math.max(this.view.clientHeight, 1);
      this.gaze.step(timeMs, elapsedMs);
    }
    const picture = this.video.take();
    if (picture !== undefined) {
      this.pictureUs = picture.captureUs;
      this.world.show(picture);
      this.shown(picture.sequence, timeMs);
      if (this.control.clock.known) {
        this.measure("drawn", (this.control.clock.nowUs() - picture.captureUs) / 1000);
      }
      if (this.unwound) this.world.baseYaw = this.trail.at(picture.captureUs);
    }
    if (!this.xr.active) this.world.look(this.gaze.yaw, this.gaze.pitch, this.gaze.roll, this.gaze.fovV);
    if (timeMs - this.mapMs > MAP_MS) {
      this.mapMs = timeMs;
      this.plan.draw(this.state, this.scan, this.drive.heading(), this.gaze.fovH);
      this.hud.approaching(this.state?.approaching ?? [], this.drive.heading(), this.gaze.fovH);
    }
    this.hud.target(this.state?.target ?? null, this.drive.heading(), this.arrow);
    if (this.hudMs === 0) this.slow();
  }

  private shown(sequence: number, timeMs: number): void {
    if (timeMs - this.shownMs < SHOWN_MS) return;
    this.shownMs = timeMs;
    this.control.send({ kind: "shown", seq: sequence, dropped: this.video.dropped });
  }

  /** Ten times a second: everything written. */
  private slow(): void {
    this.hudMs = performance.now();
    this.hud.connection(this.quality, this.trouble, this.video.rate, this.video.dropped);
    this.hud.rights(this.drive.right, this.hello?.role ?? "");
    this.hud.robot(this.state, this.hello?.robot ?? "");
    this.hud.command(this.state, this.drive, this.hello?.v_max ?? 1, this.hello?.w_max ?? 1);
    this.hud.say(this.banners());
    const state = this.state;
    this.panel.draw(state?.cue ?? "none", this.trouble || (state?.arm ?? ""), reasons(state, this.drive.right) || `${(state?.applied.v ?? 0).toFixed(2)} m/s`);
  }

  private banners(): Banner[] {
    const now = performance.now();
    const said: Banner[] = [];
    const bad = (words: string): number => said.push({ level: "bad", words });
    const warn = (words: string): number => said.push({ level: "warn", words });
    const { state, quality } = this;
    if (this.trouble) bad(this.trouble);
    else if (now - this.stateMs > STATE_STALE_MS) bad("the robot says nothing");
    if (state?.arm === "estop") bad("Emergency stop. Press Reset, then Arm, when the way is clear.");
    if (state !== undefined) {
      for (const [name, device] of Object.entries(state.devices)) {
        if (device.ok) continue;
        const how = device.link === "streaming" && device.age_s !== null && device.age_s < STALE_S ? "slow" : "stale";
        warn(`${DEVICE_WORDS[name] ?? name} ${how}${device.detail ? `: ${device.detail}` : ""}`);
      }
    }
    if (!this.trouble && this.video.waiting) warn("no key frame yet: waiting for the next picture");
    if (this.video.error) warn(`this browser cannot decode the picture: ${this.video.error}`);
    if (!this.trouble && !canDecode) warn(NO_WEBCODECS);
    if (this.drive.mayDrive && quality?.lock && state?.arm === "armed") bad(`driving is locked: ${quality.lock}`);
    else if (quality?.lock && quality.lock !== "no picture is shown yet") warn(quality.lock);
    for (const { words, untilMs } of this.notices) if (untilMs > now) warn(words);
    if (state?.found) said.push({ level: "good", words: "target found" });
    return said;
  }

  private zoomed(): void {
    const slider = element("fov", HTMLInputElement);
    slider.value = String(Math.round(degrees(this.gaze.fovV)));
    write(element("fov-text", HTMLOutputElement), `${slider.value}°`);
  }

  private keys(): void {
    const actions: Record<string, () => void> = {
      Space: () => this.drive.estop(),
      Escape: () => this.drive.estop(),
      Enter: () => this.drive.arm(),
      KeyX: () => this.drive.disarm(),
      KeyT: () => this.takeOrGive(),
      KeyC: () => this.drive.found(),
      KeyU: () => this.unwind(!this.unwound),
      KeyB: () => this.showArrow(!this.arrow),
      KeyL: () => (this.world.ringVisible = this.ring = !this.ring),
      KeyO: () => (this.allBoxes = !this.allBoxes),
      KeyM: () => this.mark(),
      KeyH: () => this.help(),
      Equal: () => this.gaze.zoom(this.gaze.fovV - radians(5)),
      NumpadAdd: () => this.gaze.zoom(this.gaze.fovV - radians(5)),
      Minus: () => this.gaze.zoom(this.gaze.fovV + radians(5)),
      NumpadSubtract: () => this.gaze.zoom(this.gaze.fovV + radians(5)),
    };
    addEventListener("keydown", (event) => {
      const stops = event.code === "Space" || event.code === "Escape";
      const typing = event.target instanceof HTMLInputElement && ["text", "password"].includes(event.target.type);
      if (typing && event.code !== "Escape") return;
      if (!stops && (event.ctrlKey || event.metaKey || event.altKey)) return;
      const ours = this.drive.press(event.code, event.repeat) || this.gaze.press(event.code, event.repeat);
      if (!ours && actions[event.code] === undefined) return;
      event.preventDefault();
      if (!ours && !event.repeat) actions[event.code]!();
    });
    addEventListener("keyup", (event) => {
      this.drive.lift(event.code);
      this.gaze.lift(event.code);
      if (event.code === "Space" || event.code === "Enter") event.preventDefault(); // no click on a focused button
    });
  }

  private buttons(): void {
    const on = (id: string, act: () => void): void => {
      element(id, HTMLButtonElement).onclick = act;
    };
    element("estop", HTMLButtonElement).onpointerdown = () => this.drive.estop();
    on("estop", () => this.drive.estop());
    on("take", () => this.takeOrGive());
    on("arm", () => this.drive.arm());
    on("disarm", () => this.drive.disarm());
    on("found", () => this.drive.found());
    on("mark", () => this.mark());
    on("help-button", () => this.help());
    on("help-close", () => this.help());
    const hold = element("hold", HTMLButtonElement);
    hold.onpointerdown = (event) => {
      hold.setPointerCapture(event.pointerId);
      this.drive.hold("button", null);
    };
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      hold.addEventListener(name, () => this.drive.let("button"));
    }
    hold.oncontextmenu = (event) => event.preventDefault();
    element("fov", HTMLInputElement).oninput = (event) => this.gaze.zoom(radians(Number((event.target as HTMLInputElement).value)));
    const throttle = element("throttle", HTMLInputElement);
    throttle.value = String(this.drive.throttle * 100);
    const share = (): void => {
      this.drive.throttle = Number(throttle.value) / 100;
      write(element("speed-share", HTMLOutputElement), `${throttle.value} %`);
    };
    throttle.oninput = share;
    share();
    element("stream", HTMLSelectElement).onchange = (event) => {
      if (this.hello !== undefined) this.video.open(this.hello.conn, (event.target as HTMLSelectElement).value as StreamName);
    };
    element("unwound", HTMLInputElement).onchange = (event) => this.unwind((event.target as HTMLInputElement).checked);
    element("arrow", HTMLInputElement).onchange = (event) => this.showArrow((event.target as HTMLInputElement).checked);
    const note = element("note", HTMLInputElement);
    note.onfocus = () => this.drive.release(); // who writes does not drive
    note.onkeydown = (event) => {
      if (event.code === "Enter") this.mark();
      if (event.code !== "Space" || note.value !== "") return;
      event.preventDefault(); // no note begins with a space
      this.drive.estop();
    };
    const tilt = element("tilt", HTMLButtonElement);
    tilt.hidden = !matchMedia("(pointer: coarse)").matches;
    tilt.onclick = () =>
      void this.gaze.followDevice().then((follows) => write(tilt, follows ? "Stop following" : "Follow the phone"));
    element("login", HTMLElement).querySelector("form")!.onsubmit = (event) => {
      event.preventDefault();
      void logIn(element("token", HTMLInputElement).value).then((right) => {
        write(element("login-text", HTMLElement), right ? "" : "That is not one of this robot's tokens.");
        if (right) this.control.connect();
      });
    };
  }

  private takeOrGive(): void {
    const right = this.drive.right;
    this.control.send({ kind: "lease", wish: right?.yours ? "release" : right?.may_take ? "take" : "ask" });
  }

  private unwind(on: boolean): void {
    this.unwound = on;
    element("unwound", HTMLInputElement).checked = on;
    const before = this.world.baseYaw;
    this.world.baseYaw = on ? this.trail.at(this.pictureUs) : 0;
    this.gaze.carry(wrap(this.world.baseYaw - before));
  }

  private showArrow(on: boolean): void {
    this.arrow = on;
    element("arrow", HTMLInputElement).checked = on;
  }

  private mark(): void {
    const note = element("note", HTMLInputElement);
    if (!this.control.send({ kind: "bookmark", note: note.value.trim() })) return;
    this.notice("this moment is marked in the recording");
    note.value = "";
    note.blur();
  }

  private help(): void {
    const help = element("help", HTMLElement);
    help.hidden = !help.hidden;
  }
}

const DEVICE_WORDS: Record<string, string> = { theta: "camera", tim571: "lidar", rmp110: "base" };
const NO_WEBCODECS =
  "This browser cannot decode live video here (it needs WebCodecs, and an https address): still pictures only, once a second. You may look and stop, not drive.";

void Page.open().then((page) => Object.defineProperty(globalThis, "telepresence", { get: () => page.inside }));
