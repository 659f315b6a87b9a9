"""The JSON Schema of the manifest format, generated from the models.

`python -m gmrdata.manifest.schema` writes it to manifests/schema/v1.json of a checkout; a test
compares the two.
"""

from typing import Any

from gmrdata.manifest.read import ADAPTER
from gmrdata.progress import console
from gmrdata.resources import schema_v1
from gmrdata.store import write_json


def json_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of `format: gmrdata/1`.

    It can't say everything: that kept and dropped ranges tile a clip, that ids are unique and that
    paths stay inside are checked by `gmrdata manifest check` alone.
    """
    return ADAPTER.json_schema() | {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "gmrdata manifest, format gmrdata/1",
    }


if __name__ == "__main__":
    write_json(schema_v1().resolve(), json_schema())
    console.print(f"wrote {schema_v1().resolve()}")
