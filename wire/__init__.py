"""Every format that crosses a process boundary. Imports nothing of ours, and nothing here."""
