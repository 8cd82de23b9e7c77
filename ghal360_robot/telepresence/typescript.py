"""The page's side of the protocol, made of the server's: `python -m ghal360_robot.telepresence.typescript`.

Writes `page/src/protocol.gen.ts`: a type for every message, and the JSON schema that `validate.ts` checks by.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from ghal360_robot.telepresence.protocol import VERSION, FromPage, FromServer

TARGET = Path(__file__).parent / "page" / "src" / "protocol.gen.ts"
HEAD = "// Made by `python -m ghal360_robot.telepresence.typescript`; change telepresence/protocol.py instead.\n"
SAID_BY_CODE = {"title", "description", "default"}


def schema() -> dict[str, Any]:
    """The definitions of all messages, and what each side may say."""
    sides: dict[str, Any] = {"FromPage": FromPage, "FromServer": FromServer}
    inputs: list[tuple[str, Literal["validation"], TypeAdapter[Any]]] = [
        (name, "validation", TypeAdapter(kind)) for name, kind in sides.items()
    ]
    roots, shared = TypeAdapter.json_schemas(inputs, ref_template="#/$defs/{model}")
    definitions = dict(shared["$defs"])
    definitions.update({name: roots[name, "validation"] for name in sides})
    stripped: dict[str, Any] = _strip({"$defs": definitions})
    return stripped


def source() -> str:
    """The whole file."""
    whole = schema()
    types = [_declaration(name, definition) for name, definition in sorted(whole["$defs"].items())]
    kept = json.dumps(whole, indent=2, sort_keys=True)
    return "\n".join((HEAD, f"export const VERSION = {VERSION};", "", *types, f"export const SCHEMA = {kept};", ""))


def _strip(node: Any) -> Any:
    """Without titles and prose; names of properties that happen to be called so stay."""
    if isinstance(node, list):
        return [_strip(item) for item in node]
    if not isinstance(node, dict):
        return node
    return {
        key: {name: _strip(value) for name, value in child.items()} if key in {"properties", "$defs"} else _strip(child)
        for key, child in node.items()
        if key not in SAID_BY_CODE
    }


def _declaration(name: str, definition: dict[str, Any]) -> str:
    if definition.get("type") != "object":
        return f"export type {name} = {_type(definition)};\n"
    required = set(definition.get("required", ()))
    lines = [
        f"  {key}{'' if key in required else '?'}: {_type(value)};"
        for key, value in definition.get("properties", {}).items()
    ]
    return "\n".join((f"export interface {name} {{", *lines, "}\n"))


def _type(node: dict[str, Any]) -> str:
    if "$ref" in node:
        return str(node["$ref"].rsplit("/", 1)[1])
    if "const" in node:
        return json.dumps(node["const"])
    if "enum" in node:
        return " | ".join(json.dumps(value) for value in node["enum"])
    for key in ("anyOf", "oneOf"):
        if key in node:
            return " | ".join(_type(option) for option in node[key])
    match node.get("type"):
        case "array" if "prefixItems" in node:
            return f"[{', '.join(_type(item) for item in node['prefixItems'])}]"
        case "array":
            return f"({_type(node['items'])})[]"
        case "object":
            return f"Record<string, {_type(node['additionalProperties'])}>"
        case "integer" | "number":
            return "number"
        case str(simple):
            return simple
    raise ValueError(f"no TypeScript for {node}")


def main() -> None:
    TARGET.write_text(source(), encoding="utf-8")


if __name__ == "__main__":
    main()
