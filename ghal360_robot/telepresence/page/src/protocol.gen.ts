// Made by `python -m ghal360_robot.telepresence.typescript`; change telepresence/protocol.py instead.

export const VERSION = 1;

export interface Bookmark {
  kind: "bookmark";
  note?: string;
}

export interface Box {
  name: string;
  score: number;
  yaw: number;
  pitch: number;
  width: number;
  height: number;
  target: boolean;
}

export interface Device {
  link: string;
  detail: string;
  age_s: number | null;
  ok: boolean;
}

export interface Echo {
  kind: "echo";
  nonce: number;
}

export interface Floor {
  kind: "floor";
  png: string;
  resolution_m: number;
  x: number;
  y: number;
  path: ([number, number])[];
}

export type FromPage = Operate | Stop | LeaseWish | Bookmark | Shown | Echo | Ping;

export type FromServer = Hello | Pong | Probe | State | Scan | Floor | Right | Quality | Refused;

export interface Hello {
  kind: "hello";
  version: number;
  conn: string;
  name: string;
  role: "viewer" | "driver";
  robot: string;
  target: string;
  v_max: number;
  w_max: number;
  camera_yaw: number;
  picture_hold_s: number;
  blind: [number, number];
  streams: ("camera" | "small" | "stills")[];
  arrow?: "wedges" | "continuous";
}

export interface LeaseWish {
  kind: "lease";
  wish: "ask" | "take" | "release" | "hand_over" | "keep";
}

export interface Operate {
  kind: "operate";
  conn: string;
  seq: number;
  sent_us: number;
  yaw: number;
  pitch: number;
  fov_h: number;
  fov_v: number;
  mode: "screen" | "touch" | "xr";
  deadman: boolean;
  stick: Stick | null;
  arm: number;
  disarm: number;
  found: number;
}

export interface Ping {
  kind: "ping";
  t0: number;
}

export interface Place {
  x: number;
  y: number;
  yaw: number;
}

export interface Pong {
  kind: "pong";
  t0: number;
  received_us: number;
  sent_us: number;
}

export interface Probe {
  kind: "probe";
  nonce: number;
}

export interface Quality {
  kind: "quality";
  round_trip_ms: number | null;
  loop_ms: number | null;
  picture_ms: number | null;
  dropped: number;
  bit_rate: number;
  lock: string;
  viewers: number;
}

export interface Refused {
  kind: "refused";
  what: string;
  why: string;
}

export interface Right {
  kind: "right";
  driver: string | null;
  yours: boolean;
  asking: string | null;
  may_take: boolean;
  words: string;
}

export interface Scan {
  kind: "scan";
  t_us: number;
  first: number;
  step: number;
  cm: (number)[];
}

export interface Shown {
  kind: "shown";
  seq: number;
  dropped: number;
}

export interface Speed {
  v: number;
  w: number;
}

export interface State {
  kind: "state";
  t_us: number;
  tick: number;
  arm: "disarmed" | "armed" | "estop";
  blockers: (string)[];
  cue: "none" | "left" | "right" | "confirm";
  cue_us: number;
  target: number | null;
  target_m: number | null;
  intention: number | null;
  found: boolean;
  boxes: (Box)[];
  boxes_us: number;
  approaching: (number)[];
  wanted: Speed;
  applied: Speed;
  source: string;
  reasons: (string)[];
  clearance_m: number | null;
  pose: Place | null;
  speed: Speed | null;
  battery_percent: number | null;
  base: string;
  devices: Record<string, Device>;
}

export interface Stick {
  v: number;
  w: number;
}

export interface Stop {
  kind: "stop";
  level: "disarm" | "estop";
  press: number;
}

export const SCHEMA = {
  "$defs": {
    "Bookmark": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "bookmark",
          "type": "string"
        },
        "note": {
          "maxLength": 200,
          "type": "string"
        }
      },
      "required": [
        "kind"
      ],
      "type": "object"
    },
    "Box": {
      "additionalProperties": false,
      "properties": {
        "height": {
          "exclusiveMaximum": 6.283185307179586,
          "exclusiveMinimum": 0.0,
          "type": "number"
        },
        "name": {
          "maxLength": 64,
          "type": "string"
        },
        "pitch": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        },
        "score": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "target": {
          "type": "boolean"
        },
        "width": {
          "exclusiveMaximum": 6.283185307179586,
          "exclusiveMinimum": 0.0,
          "type": "number"
        },
        "yaw": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        }
      },
      "required": [
        "name",
        "score",
        "yaw",
        "pitch",
        "width",
        "height",
        "target"
      ],
      "type": "object"
    },
    "Device": {
      "additionalProperties": false,
      "properties": {
        "age_s": {
          "anyOf": [
            {
              "maximum": 1000000.0,
              "minimum": -1000000.0,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "detail": {
          "maxLength": 300,
          "type": "string"
        },
        "link": {
          "maxLength": 64,
          "type": "string"
        },
        "ok": {
          "type": "boolean"
        }
      },
      "required": [
        "link",
        "detail",
        "age_s",
        "ok"
      ],
      "type": "object"
    },
    "Echo": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "echo",
          "type": "string"
        },
        "nonce": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        }
      },
      "required": [
        "kind",
        "nonce"
      ],
      "type": "object"
    },
    "Floor": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "floor",
          "type": "string"
        },
        "path": {
          "items": {
            "maxItems": 2,
            "minItems": 2,
            "prefixItems": [
              {
                "maximum": 1000000.0,
                "minimum": -1000000.0,
                "type": "number"
              },
              {
                "maximum": 1000000.0,
                "minimum": -1000000.0,
                "type": "number"
              }
            ],
            "type": "array"
          },
          "maxItems": 512,
          "type": "array"
        },
        "png": {
          "maxLength": 200000,
          "type": "string"
        },
        "resolution_m": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "x": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "y": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        }
      },
      "required": [
        "kind",
        "png",
        "resolution_m",
        "x",
        "y",
        "path"
      ],
      "type": "object"
    },
    "FromPage": {
      "discriminator": {
        "mapping": {
          "bookmark": "#/$defs/Bookmark",
          "echo": "#/$defs/Echo",
          "lease": "#/$defs/LeaseWish",
          "operate": "#/$defs/Operate",
          "ping": "#/$defs/Ping",
          "shown": "#/$defs/Shown",
          "stop": "#/$defs/Stop"
        },
        "propertyName": "kind"
      },
      "oneOf": [
        {
          "$ref": "#/$defs/Operate"
        },
        {
          "$ref": "#/$defs/Stop"
        },
        {
          "$ref": "#/$defs/LeaseWish"
        },
        {
          "$ref": "#/$defs/Bookmark"
        },
        {
          "$ref": "#/$defs/Shown"
        },
        {
          "$ref": "#/$defs/Echo"
        },
        {
          "$ref": "#/$defs/Ping"
        }
      ]
    },
    "FromServer": {
      "discriminator": {
        "mapping": {
          "floor": "#/$defs/Floor",
          "hello": "#/$defs/Hello",
          "pong": "#/$defs/Pong",
          "probe": "#/$defs/Probe",
          "quality": "#/$defs/Quality",
          "refused": "#/$defs/Refused",
          "right": "#/$defs/Right",
          "scan": "#/$defs/Scan",
          "state": "#/$defs/State"
        },
        "propertyName": "kind"
      },
      "oneOf": [
        {
          "$ref": "#/$defs/Hello"
        },
        {
          "$ref": "#/$defs/Pong"
        },
        {
          "$ref": "#/$defs/Probe"
        },
        {
          "$ref": "#/$defs/State"
        },
        {
          "$ref": "#/$defs/Scan"
        },
        {
          "$ref": "#/$defs/Floor"
        },
        {
          "$ref": "#/$defs/Right"
        },
        {
          "$ref": "#/$defs/Quality"
        },
        {
          "$ref": "#/$defs/Refused"
        }
      ]
    },
    "Hello": {
      "additionalProperties": false,
      "properties": {
        "arrow": {
          "enum": [
            "wedges",
            "continuous"
          ],
          "type": "string"
        },
        "blind": {
          "maxItems": 2,
          "minItems": 2,
          "prefixItems": [
            {
              "maximum": 12.566370614359172,
              "minimum": -12.566370614359172,
              "type": "number"
            },
            {
              "maximum": 12.566370614359172,
              "minimum": -12.566370614359172,
              "type": "number"
            }
          ],
          "type": "array"
        },
        "camera_yaw": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        },
        "conn": {
          "maxLength": 64,
          "type": "string"
        },
        "kind": {
          "const": "hello",
          "type": "string"
        },
        "name": {
          "maxLength": 64,
          "type": "string"
        },
        "picture_hold_s": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "robot": {
          "maxLength": 64,
          "type": "string"
        },
        "role": {
          "enum": [
            "viewer",
            "driver"
          ],
          "type": "string"
        },
        "streams": {
          "items": {
            "enum": [
              "camera",
              "small",
              "stills"
            ],
            "type": "string"
          },
          "type": "array"
        },
        "target": {
          "maxLength": 64,
          "type": "string"
        },
        "v_max": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "version": {
          "type": "integer"
        },
        "w_max": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        }
      },
      "required": [
        "kind",
        "version",
        "conn",
        "name",
        "role",
        "robot",
        "target",
        "v_max",
        "w_max",
        "camera_yaw",
        "picture_hold_s",
        "blind",
        "streams"
      ],
      "type": "object"
    },
    "LeaseWish": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "lease",
          "type": "string"
        },
        "wish": {
          "enum": [
            "ask",
            "take",
            "release",
            "hand_over",
            "keep"
          ],
          "type": "string"
        }
      },
      "required": [
        "kind",
        "wish"
      ],
      "type": "object"
    },
    "Operate": {
      "additionalProperties": false,
      "properties": {
        "arm": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        },
        "conn": {
          "maxLength": 64,
          "type": "string"
        },
        "deadman": {
          "type": "boolean"
        },
        "disarm": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        },
        "found": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        },
        "fov_h": {
          "exclusiveMaximum": 6.283185307179586,
          "exclusiveMinimum": 0.0,
          "type": "number"
        },
        "fov_v": {
          "exclusiveMaximum": 6.283185307179586,
          "exclusiveMinimum": 0.0,
          "type": "number"
        },
        "kind": {
          "const": "operate",
          "type": "string"
        },
        "mode": {
          "enum": [
            "screen",
            "touch",
            "xr"
          ],
          "type": "string"
        },
        "pitch": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        },
        "sent_us": {
          "maximum": 9007199254740991,
          "minimum": 0,
          "type": "integer"
        },
        "seq": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        },
        "stick": {
          "anyOf": [
            {
              "$ref": "#/$defs/Stick"
            },
            {
              "type": "null"
            }
          ]
        },
        "yaw": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        }
      },
      "required": [
        "kind",
        "conn",
        "seq",
        "sent_us",
        "yaw",
        "pitch",
        "fov_h",
        "fov_v",
        "mode",
        "deadman",
        "stick",
        "arm",
        "disarm",
        "found"
      ],
      "type": "object"
    },
    "Ping": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "ping",
          "type": "string"
        },
        "t0": {
          "maximum": 1000000000000.0,
          "minimum": 0.0,
          "type": "number"
        }
      },
      "required": [
        "kind",
        "t0"
      ],
      "type": "object"
    },
    "Place": {
      "additionalProperties": false,
      "properties": {
        "x": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "y": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "yaw": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        }
      },
      "required": [
        "x",
        "y",
        "yaw"
      ],
      "type": "object"
    },
    "Pong": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "pong",
          "type": "string"
        },
        "received_us": {
          "maximum": 9007199254740991,
          "minimum": 0,
          "type": "integer"
        },
        "sent_us": {
          "maximum": 9007199254740991,
          "minimum": 0,
          "type": "integer"
        },
        "t0": {
          "maximum": 1000000000000.0,
          "minimum": 0.0,
          "type": "number"
        }
      },
      "required": [
        "kind",
        "t0",
        "received_us",
        "sent_us"
      ],
      "type": "object"
    },
    "Probe": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "probe",
          "type": "string"
        },
        "nonce": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        }
      },
      "required": [
        "kind",
        "nonce"
      ],
      "type": "object"
    },
    "Quality": {
      "additionalProperties": false,
      "properties": {
        "bit_rate": {
          "maximum": 1000000000000.0,
          "minimum": 0.0,
          "type": "number"
        },
        "dropped": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        },
        "kind": {
          "const": "quality",
          "type": "string"
        },
        "lock": {
          "maxLength": 300,
          "type": "string"
        },
        "loop_ms": {
          "anyOf": [
            {
              "maximum": 1000000.0,
              "minimum": -1000000.0,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "picture_ms": {
          "anyOf": [
            {
              "maximum": 1000000.0,
              "minimum": -1000000.0,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "round_trip_ms": {
          "anyOf": [
            {
              "maximum": 1000000.0,
              "minimum": -1000000.0,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "viewers": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        }
      },
      "required": [
        "kind",
        "round_trip_ms",
        "loop_ms",
        "picture_ms",
        "dropped",
        "bit_rate",
        "lock",
        "viewers"
      ],
      "type": "object"
    },
    "Refused": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "refused",
          "type": "string"
        },
        "what": {
          "maxLength": 64,
          "type": "string"
        },
        "why": {
          "maxLength": 300,
          "type": "string"
        }
      },
      "required": [
        "kind",
        "what",
        "why"
      ],
      "type": "object"
    },
    "Right": {
      "additionalProperties": false,
      "properties": {
        "asking": {
          "anyOf": [
            {
              "maxLength": 64,
              "type": "string"
            },
            {
              "type": "null"
            }
          ]
        },
        "driver": {
          "anyOf": [
            {
              "maxLength": 64,
              "type": "string"
            },
            {
              "type": "null"
            }
          ]
        },
        "kind": {
          "const": "right",
          "type": "string"
        },
        "may_take": {
          "type": "boolean"
        },
        "words": {
          "maxLength": 300,
          "type": "string"
        },
        "yours": {
          "type": "boolean"
        }
      },
      "required": [
        "kind",
        "driver",
        "yours",
        "asking",
        "may_take",
        "words"
      ],
      "type": "object"
    },
    "Scan": {
      "additionalProperties": false,
      "properties": {
        "cm": {
          "items": {
            "maximum": 10000,
            "minimum": 0,
            "type": "integer"
          },
          "maxItems": 720,
          "type": "array"
        },
        "first": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        },
        "kind": {
          "const": "scan",
          "type": "string"
        },
        "step": {
          "maximum": 12.566370614359172,
          "minimum": -12.566370614359172,
          "type": "number"
        },
        "t_us": {
          "maximum": 9007199254740991,
          "minimum": 0,
          "type": "integer"
        }
      },
      "required": [
        "kind",
        "t_us",
        "first",
        "step",
        "cm"
      ],
      "type": "object"
    },
    "Shown": {
      "additionalProperties": false,
      "properties": {
        "dropped": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        },
        "kind": {
          "const": "shown",
          "type": "string"
        },
        "seq": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        }
      },
      "required": [
        "kind",
        "seq",
        "dropped"
      ],
      "type": "object"
    },
    "Speed": {
      "additionalProperties": false,
      "properties": {
        "v": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        },
        "w": {
          "maximum": 1000000.0,
          "minimum": -1000000.0,
          "type": "number"
        }
      },
      "required": [
        "v",
        "w"
      ],
      "type": "object"
    },
    "State": {
      "additionalProperties": false,
      "properties": {
        "applied": {
          "$ref": "#/$defs/Speed"
        },
        "approaching": {
          "items": {
            "maximum": 12.566370614359172,
            "minimum": -12.566370614359172,
            "type": "number"
          },
          "maxItems": 12,
          "type": "array"
        },
        "arm": {
          "enum": [
            "disarmed",
            "armed",
            "estop"
          ],
          "type": "string"
        },
        "base": {
          "maxLength": 64,
          "type": "string"
        },
        "battery_percent": {
          "anyOf": [
            {
              "maximum": 1000000.0,
              "minimum": -1000000.0,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "blockers": {
          "items": {
            "maxLength": 300,
            "type": "string"
          },
          "maxItems": 12,
          "type": "array"
        },
        "boxes": {
          "items": {
            "$ref": "#/$defs/Box"
          },
          "maxItems": 32,
          "type": "array"
        },
        "boxes_us": {
          "maximum": 9007199254740991,
          "minimum": 0,
          "type": "integer"
        },
        "clearance_m": {
          "anyOf": [
            {
              "maximum": 1000000.0,
              "minimum": -1000000.0,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "cue": {
          "enum": [
            "none",
            "left",
            "right",
            "confirm"
          ],
          "type": "string"
        },
        "cue_us": {
          "maximum": 9007199254740991,
          "minimum": 0,
          "type": "integer"
        },
        "devices": {
          "additionalProperties": {
            "$ref": "#/$defs/Device"
          },
          "propertyNames": {
            "maxLength": 64
          },
          "type": "object"
        },
        "found": {
          "type": "boolean"
        },
        "intention": {
          "anyOf": [
            {
              "maximum": 12.566370614359172,
              "minimum": -12.566370614359172,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "kind": {
          "const": "state",
          "type": "string"
        },
        "pose": {
          "anyOf": [
            {
              "$ref": "#/$defs/Place"
            },
            {
              "type": "null"
            }
          ]
        },
        "reasons": {
          "items": {
            "maxLength": 300,
            "type": "string"
          },
          "maxItems": 12,
          "type": "array"
        },
        "source": {
          "maxLength": 64,
          "type": "string"
        },
        "speed": {
          "anyOf": [
            {
              "$ref": "#/$defs/Speed"
            },
            {
              "type": "null"
            }
          ]
        },
        "t_us": {
          "maximum": 9007199254740991,
          "minimum": 0,
          "type": "integer"
        },
        "target": {
          "anyOf": [
            {
              "maximum": 12.566370614359172,
              "minimum": -12.566370614359172,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "target_m": {
          "anyOf": [
            {
              "maximum": 1000000.0,
              "minimum": -1000000.0,
              "type": "number"
            },
            {
              "type": "null"
            }
          ]
        },
        "tick": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        },
        "wanted": {
          "$ref": "#/$defs/Speed"
        }
      },
      "required": [
        "kind",
        "t_us",
        "tick",
        "arm",
        "blockers",
        "cue",
        "cue_us",
        "target",
        "target_m",
        "intention",
        "found",
        "boxes",
        "boxes_us",
        "approaching",
        "wanted",
        "applied",
        "source",
        "reasons",
        "clearance_m",
        "pose",
        "speed",
        "battery_percent",
        "base",
        "devices"
      ],
      "type": "object"
    },
    "Stick": {
      "additionalProperties": false,
      "properties": {
        "v": {
          "maximum": 1.0,
          "minimum": -1.0,
          "type": "number"
        },
        "w": {
          "maximum": 1.0,
          "minimum": -1.0,
          "type": "number"
        }
      },
      "required": [
        "v",
        "w"
      ],
      "type": "object"
    },
    "Stop": {
      "additionalProperties": false,
      "properties": {
        "kind": {
          "const": "stop",
          "type": "string"
        },
        "level": {
          "enum": [
            "disarm",
            "estop"
          ],
          "type": "string"
        },
        "press": {
          "exclusiveMaximum": 1000000000,
          "minimum": 0,
          "type": "integer"
        }
      },
      "required": [
        "kind",
        "level",
        "press"
      ],
      "type": "object"
    }
  }
};
