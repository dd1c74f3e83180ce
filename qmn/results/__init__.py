"""Run folders: result, artifacts, timeline."""
