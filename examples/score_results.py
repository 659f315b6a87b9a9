"""Results of any system, or a network, to scores: python score_results.py results set.yaml out"""

import sys

import gmrdata

if __name__ == "__main__":
    results, manifest, out = sys.argv[1:]
    for path in gmrdata.score(results, manifest, out).scores:
        error = gmrdata.Scores.read(path).overall.pooled_over_motions.predicted
        print(f"{path}: OME {error.ome_deg:.2f} deg, TME {error.tme_mm:.1f} mm")
