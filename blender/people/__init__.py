# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is filmed: bodies with clothes, rigged characters, company."""
