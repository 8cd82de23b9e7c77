"""From the configuration to the pure parts: one place that says which setting goes where."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibration.mounting import CameraMount, LidarMount
from ghal360_robot.brain import Brain
from ghal360_robot.errors import UsageError
from ghal360_robot.guidance.belief import DetectorModel
from ghal360_robot.guidance.online import LearnedPolicy, Learning, OnlineLearner
from ghal360_robot.guidance.policy import make_policy
from ghal360_robot.guidance.questions import QuestionSettings
from ghal360_robot.intent.controller import DriveSettings
from ghal360_robot.intent.exact import ExactFilter
from ghal360_robot.intent.particle import ParticleFilter
from ghal360_robot.intent.steering import SteeringSettings
from ghal360_robot.intent.trigger import TriggerSettings
from ghal360_robot.logbook.disk import Watermarks
from ghal360_robot.logbook.settings import LiveSettings, RecorderSettings
from ghal360_robot.perception.bearing_out import AskSettings
from ghal360_robot.perception.detectors.base import DetectorOptions
from ghal360_robot.perception.names import canonical
from ghal360_robot.perception.panorama import CameraView
from ghal360_robot.perception.sphere import SphereBox
from ghal360_robot.perception.tiles import PLANS
from ghal360_robot.perception.tracking import TrackSettings
from ghal360_robot.safety.chain import Safety
from ghal360_robot.safety.derating import BATTERY, LATENCY, RULES, TEMPERATURE, Rule
from ghal360_robot.safety.footprint import Disc
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.mux import AUTONOMY, TELEOP, TEST, LockRule, Source

if TYPE_CHECKING:
    from ghal360_robot.config import RobotConfig, SafetySection
    from ghal360_robot.guidance.saved import SavedPolicy

COMFORT_M = 0.12
"""Kept beside the footprint where there is room."""

TIGHT_M = 0.01
"""In a door, steering keeps this much more than the stop zone, or the two would argue there."""

SQUEEZE_M = 0.02
"""In a door so narrow that noise closes it every other scan, the safety chain lets the robot crawl on where that takes
no clearance away; steering that gave up the way each time would stand in it for half a minute."""

AT_ONCE = 1e-9
"""A belief in the target that every sighting exceeds."""

STEADY_S = 0.2
RELEASE = 0.5
"""Three samples above the threshold to begin, half the probability to end: fewest false triggers measured."""


def lidar_mount(config: RobotConfig) -> LidarMount:
    m = config.mounting
    return LidarMount(m.lidar_x_m, m.lidar_y_m, m.lidar_z_m, math.radians(m.lidar_yaw_deg), m.lidar_upside_down)


def camera_mount(config: RobotConfig) -> CameraMount:
    m = config.mounting
    return CameraMount(m.camera_x_m, m.camera_y_m, m.camera_z_m, math.radians(m.camera_yaw_deg))


def camera_view(config: RobotConfig) -> CameraView:
    m = config.mounting
    yaw, pitch, roll = (math.radians(angle) for angle in (m.camera_yaw_deg, m.camera_pitch_deg, m.camera_roll_deg))
    body = tuple(SphereBox(*(math.radians(angle) for angle in box)) for box in config.perception.body)
    return CameraView(yaw, pitch, roll, body)


def detector_options(config: RobotConfig) -> DetectorOptions:
    p = config.perception
    return DetectorOptions(
        plan=p.plan,
        min_score=p.score or None,
        thresholds=p.scores,
        threads=p.threads,
        device=p.device,
        precision=p.precision,
    )


def safety_limits(config: RobotConfig) -> SafetyLimits:
    s = config.safety
    return SafetyLimits(
        v_max=s.v_max,
        w_max=s.w_max,
        accel=s.accel,
        decel=s.decel,
        w_accel=s.w_accel,
        reverse_max=s.reverse_max,
        wheel_max=s.wheel_max,
        track_m=config.rmp110.track_m,
        footprint=tuple(Disc(*disc) for disc in s.footprint),
        margin_m=s.margin_m,
        standoff_m=s.standoff_m,
        slow_margin_m=s.slow_margin_m,
        slow_max=s.slow_max,
        person_margin_m=s.person_margin_m,
        person_speed=s.person_speed,
        person_memory_s=s.person_memory_s,
        ground_memory_s=s.ground_memory_s,
        reaction_s=s.reaction_s,
        tick_gap_s=s.tick_gap_s,
        lease_s=s.lease_s,
        sources=(
            Source(TELEOP, 100, s.operator_hold_s, s.operator_lost_s),
            Source(TEST, 50, s.command_hold_s, s.command_lost_s),
            Source(AUTONOMY, 10, s.command_hold_s, s.command_lost_s),
        ),
        locks=tuple(LockRule(name, priority, s.lock_hold_s) for name, priority in s.locks.items()),
        deratings=tuple(_rule(rule, s) for rule in RULES),
        hold_s=(
            ("operator", s.operator_hold_s),
            ("tim571", s.lidar_hold_s),
            ("rmp110", s.base_hold_s),
            ("theta", s.video_hold_s),
        ),
        lost_s=(
            ("operator", s.operator_lost_s),
            ("tim571", s.lidar_lost_s),
            ("rmp110", s.base_lost_s),
            ("theta", s.video_lost_s),
        ),
    )


def _rule(rule: Rule, safety: SafetySection) -> Rule:
    """The table's row with this robot's thresholds, where it has some of its own."""
    thresholds = {
        LATENCY: safety.latency_s,
        BATTERY: safety.battery_percent,
        TEMPERATURE: safety.temperature_degc,
    }.get(rule.name)
    return rule if thresholds is None else replace(rule, warn=thresholds[0], derate=thresholds[1], stop=thresholds[2])


def recorder_settings(config: RobotConfig) -> RecorderSettings:
    s = config.logbook
    marks = (round(gb * 1e9) for gb in (s.warn_free_gb, s.no_video_free_gb, s.stop_free_gb))
    return RecorderSettings(
        second_directory=Path(s.second_directory) if s.second_directory else None,
        part_bytes=round(s.part_mb * 1e6),
        part_s=s.part_minutes * 60.0,
        watermarks=Watermarks(*marks),
        video_always=s.video == "always",
    )


def live_settings(config: RobotConfig) -> LiveSettings | None:
    """Where viewers may watch; None where nobody may."""
    s = config.logbook
    if not s.live:
        return None
    host, _, port = s.live.rpartition(":")
    return LiveSettings(host.removeprefix("[").removesuffix("]"), int(port), s.live_web_port or None)


def make_safety(config: RobotConfig) -> Safety:
    return Safety(safety_limits(config))


def track_settings(config: RobotConfig) -> TrackSettings:
    """How sightings become objects; a detector that looks seldom or misses often needs a longer memory."""
    p, camera = config.perception, camera_mount(config)
    plan = PLANS[p.plan]
    memory_s = p.memory_s * (len(plan.tiles) if plan.one_a_turn else 1)
    return TrackSettings(
        confirm=p.min_score,
        release=p.min_score / 2,
        confirm_class={canonical(name): value for name, value in p.believe.items()},
        memory_s=memory_s,
        fading_s=2 * memory_s,
        camera=(camera.x, camera.y, camera.z),
        asking=ask_settings(config),
    )


def ask_settings(config: RobotConfig) -> AskSettings:
    """Which sightings bear a question out."""
    g = config.guidance
    return AskSettings(
        score=g.ask_score,
        score_class={canonical(name): value for name, value in g.ask_scores.items()},
        sizes={canonical(name): bounds for name, bounds in g.sizes.items()},
        camera_height=config.mounting.camera_z_m,
    )


def _fusion(config: RobotConfig) -> DetectorModel | None:
    """None where a picture is searched in parts by turns: not finding the target in a part says little."""
    g = config.guidance
    if (not g.sure and g.act_on == "tracks") or PLANS[config.perception.plan].one_a_turn:
        return None
    return DetectorModel(hit_rate=g.hit_rate, false_rate=g.false_rate, sure=g.sure or AT_ONCE)


def _intent_filter(config: RobotConfig) -> ExactFilter | ParticleFilter:
    intent = config.intent
    trigger = TriggerSettings(intent.threshold, RELEASE if intent.threshold >= RELEASE else None, STEADY_S)
    if intent.filter == "particle":
        return ParticleFilter(trigger=trigger, particles=intent.particles, seed=intent.seed)
    return ExactFilter(trigger=trigger)


def make_brain(config: RobotConfig, known: SavedPolicy | None = None) -> Brain:
    """`known` is what is known of this operator, or the policy to use with `policy = "learned"`.

    Raises UsageError where the learned policy is asked for and there is none.
    """
    safety, guidance = config.safety, config.guidance
    if guidance.policy == "learned" and known is None:
        raise UsageError("guidance.policy is 'learned': name the file of it with guidance.memory")
    learned = guidance.policy == "learned" and known is not None
    learner = None if guidance.learn == "off" else OnlineLearner(Learning(guidance.learn))
    tight = safety.margin_m + TIGHT_M
    outline_m = max(math.hypot(x, y) + radius for x, y, radius in safety.footprint)
    steering = SteeringSettings(radius_m=outline_m, margins_m=(max(COMFORT_M, tight), tight, min(SQUEEZE_M, tight)))
    return Brain(
        target=canonical(config.perception.target),
        policy=LearnedPolicy(known.q) if learned and known is not None else make_policy(guidance.policy),
        fusion=_fusion(config),
        questions=QuestionSettings(guidance.no_after_s, guidance.again_m, guidance.again_s),
        act_on_belief=guidance.act_on == "belief",
        learner=learner,
        known=None if known is None else known.learnt,
        scene=track_settings(config),
        intent=_intent_filter(config),
        drive=DriveSettings(v_max=safety.v_max, w_max=safety.w_max, steering=steering),
        drive_while_guiding=config.intent.drive_while_guiding,
        cue_patience_s=config.intent.cue_patience_s,
    )
