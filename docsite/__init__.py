"""The docs as a site: pages out of the code, the navigation, and checks of what was built."""
