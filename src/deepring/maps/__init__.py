"""What an engineer on a robot uses: build a map, save it, open it, localise a scan."""
