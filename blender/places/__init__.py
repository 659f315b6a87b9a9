# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a clip is filmed: one module for each kind of place."""
