/** What is written over the view: connection, rights, cues, commands and their reasons. */

import { clamp, degrees, wrap } from "./angles.ts";
import { element, write } from "./dom.ts";
import type { Drive } from "./drive.ts";
import type { Quality, Right, Speed, State } from "./protocol.gen.ts";

export interface Banner {
  level: "good" | "warn" | "bad";
  words: string;
}

type Level = Banner["level"];

const MARKS: Record<Level, string> = { good: "✓", warn: "!", bad: "✕" };
const SLOW_MS = 300;
const STUCK_MS = 800;
const DIAL = 40;

export class Hud {
  private readonly pill = element("pill", HTMLElement);
  private readonly pillMark = element("pill-mark", HTMLElement);
  private readonly pillText = element("pill-text", HTMLElement);
  private readonly right = element("right", HTMLElement);
  private readonly rightText = element("right-text", HTMLElement);
  private readonly robotText = element("robot-text", HTMLElement);
  private readonly banners = element("banners", HTMLElement);
  private readonly cues = {
    left: element("cue-left", HTMLElement),
    right: element("cue-right", HTMLElement),
    confirm: element("cue-confirm", HTMLElement),
  };
  private readonly edges = element("edges", HTMLElement);
  private readonly bearing = element("bearing", HTMLElement);
  private readonly armText = element("arm-text", HTMLElement);
  private readonly speedText = element("speed-text", HTMLElement);
  private readonly reasonText = element("reason-text", HTMLElement);
  private readonly estop = element("estop", HTMLButtonElement);
  private readonly take = element("take", HTMLButtonElement);
  private readonly arm = element("arm", HTMLButtonElement);
  private readonly disarm = element("disarm", HTMLButtonElement);
  private readonly hold = element("hold", HTMLButtonElement);
  private told = "";

  /** The pill: control round trip, video age, pictures a second, drops. */
  connection(quality: Quality | undefined, trouble: string, fps: number, dropped: number): Level {
    let level: Level = "good";
    let words = trouble;
    if (trouble || quality === undefined) level = "bad";
    else {
      const slow = Math.max(quality.round_trip_ms ?? 0, quality.loop_ms ?? 0);
      if (slow > STUCK_MS || quality.picture_ms === null) level = "bad";
      else if (slow > SLOW_MS || quality.lock) level = "warn";
      words = [
        `control ${ms(quality.round_trip_ms)}`,
        `video ${ms(quality.picture_ms)}`,
        `${fps.toFixed(0)} fps`,
        `${dropped + quality.dropped} dropped`,
        `${(quality.bit_rate / 1e6).toFixed(1)} Mb/s`,
      ].join(" · ");
    }
    this.pill.dataset["level"] = level;
    write(this.pillMark, MARKS[level]);
    write(this.pillText, words || "connecting ...");
    return level;
  }

  rights(right: Right | undefined, role: string): void {
    write(this.rightText, role === "viewer" ? `${right?.words ?? ""} · you may look and stop` : (right?.words ?? "no connection"));
    this.right.dataset["level"] = right?.yours ? "yours" : "none";
    write(this.take, right?.yours ? "Give back" : right?.driver ? (right.may_take ? "Take over" : "Ask to drive") : "Drive");
    this.take.disabled = right === undefined || role === "viewer";
  }

  /** Everything that is wrong, worst first. */
  say(banners: Banner[]): void {
    const key = banners.map((banner) => banner.level + banner.words).join("|");
    if (key === this.told) return;
    this.told = key;
    this.banners.replaceChildren(
      ...banners.map((banner) => {
        const line = document.createElement("div");
        line.className = "banner";
        line.dataset["level"] = banner.level;
        line.textContent = `${MARKS[banner.level]} ${banner.words}`;
        return line;
      }),
    );
  }

  robot(state: State | undefined, name: string): void {
    const battery = state?.battery_percent;
    write(this.robotText, `${name}${battery === null || battery === undefined ? "" : ` · battery ${battery.toFixed(0)} %`}`);
  }

  cue(cue: State["cue"]): void {
    for (const [name, target] of Object.entries(this.cues)) target.hidden = name !== cue;
    document.body.dataset["cue"] = cue;
  }

  /** Marks for what comes closer: at its place if it is in view, else at the edge it is behind. */
  approaching(yaws: number[], gaze: number, fovH: number): void {
    const marks = yaws.map((yaw) => {
      const off = wrap(yaw - gaze);
      const mark = document.createElement("span");
      mark.className = "edge";
      const inside = Math.abs(off) < fovH / 2;
      mark.dataset["side"] = inside ? "in" : off > 0 ? "left" : "right";
      mark.textContent = inside ? "▼ comes closer" : off > 0 ? "◀ ! behind" : "behind ! ▶";
      const share = inside ? 0.5 - Math.tan(off) / Math.tan(fovH / 2) / 2 : off > 0 ? 0.14 : 0.86;
      mark.style.left = `${clamp(share, 0.08, 0.92) * 100}%`;
      return mark;
    });
    if (marks.length > 0 || this.edges.childElementCount > 0) this.edges.replaceChildren(...marks);
  }

  /** An arrow around a ring: up is in front of the operator. */
  target(yaw: number | null, gaze: number, wanted: boolean): void {
    this.bearing.hidden = !wanted || yaw === null;
    if (yaw !== null) this.bearing.style.transform = `rotate(${degrees(-wrap(yaw - gaze))}deg)`;
  }

  command(state: State | undefined, drive: Drive, vMax: number, wMax: number): void {
    const arm = state?.arm ?? "disarmed";
    this.armText.dataset["arm"] = arm;
    write(this.armText, arm === "estop" ? "✕ EMERGENCY STOP" : arm === "armed" ? "● armed" : "○ disarmed");
    this.estop.dataset["on"] = String(arm === "estop");
    const [wanted, applied] = [state?.wanted ?? ZERO, state?.applied ?? ZERO];
    draw("wanted", wanted, vMax, wMax);
    draw("applied", applied, vMax, wMax);
    write(this.speedText, `${applied.v.toFixed(2)} m/s ${turn(applied.w)}`);
    write(this.reasonText, reasons(state, drive.right));
    write(this.arm, arm === "estop" ? "Reset" : "Arm");
    this.arm.disabled = !drive.mayDrive || arm === "armed";
    this.disarm.disabled = arm !== "armed";
    this.hold.disabled = !drive.mayDrive || arm !== "armed";
    this.hold.dataset["held"] = String(drive.looking);
  }
}

const ZERO: Speed = { v: 0, w: 0 };

/** Why the robot does not do more, or cannot be armed. */
export function reasons(state: State | undefined, right?: Right): string {
  if (state === undefined) return "";
  if (right !== undefined && right.driver === null) return "nobody is at the controls: press Drive";
  if (state.arm === "disarmed" && state.blockers.length > 0) return `cannot arm: ${state.blockers.join(", ")}`;
  return state.reasons.join(", ");
}

function ms(value: number | null): string {
  return value === null ? "–" : value > 10_000 ? "> 10 s" : `${value.toFixed(0)} ms`;
}

function turn(w: number): string {
  return Math.abs(w) < 0.005 ? "" : `${w > 0 ? "↺" : "↻"} ${Math.abs(degrees(w)).toFixed(0)} °/s`;
}

/** Forward is up; an arc over the arrow says how it turns. */
function draw(name: "wanted" | "applied", speed: Speed, vMax: number, wMax: number): void {
  const line = element(name, SVGLineElement);
  line.setAttribute("y2", String(-DIAL * clamp(speed.v / vMax, -1, 1)));
  const angle = clamp(speed.w / wMax, -1, 1) * 1.2;
  const [x, y] = [-DIAL * Math.sin(angle), -DIAL * Math.cos(angle)];
  const arc = Math.abs(angle) < 0.02 ? "" : `M 0 ${-DIAL} A ${DIAL} ${DIAL} 0 0 ${angle > 0 ? 0 : 1} ${x} ${y}`;
  element(`${name}-turn`, SVGPathElement).setAttribute("d", arc);
}
