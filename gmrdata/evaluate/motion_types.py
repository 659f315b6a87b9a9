"""What the person does in each clip, where a published list says it."""

from pathlib import Path

from gmrdata import resources
from gmrdata.manifest.current import ListManifest
from gmrdata.manifest.read import read_manifest


def motion_types(manifest_path: Path) -> dict[str, str]:
    """Type of motion by clip id, in the words of the list that names the clip's sequence.

    A clip has one only where its source is a sequence that a published list (the paper's Table 8 of
    CMU trials) gives a label; the others are left out.

    Raises:
        MissingInput: there is no such manifest.
        BadManifest: the manifest is broken.
    """
    labels = _published_labels()
    entries = read_manifest(manifest_path).clips
    sources = {entry.id: (entry.source.dataset, entry.source.sequence) for entry in entries}
    return {id: labels[source] for id, source in sources.items() if source in labels}


def _published_labels() -> dict[tuple[str, str], str]:
    """Label by data set and sequence."""
    labels: dict[tuple[str, str], str] = {}
    for name in resources.published_names():
        published = read_manifest(resources.published_manifest(name))
        if isinstance(published, ListManifest):
            for row in published.clips:
                if row.label is not None:
                    labels.setdefault((row.source.dataset, row.source.sequence), row.label)
    return labels
