"""The containers of ROS bags: MCAP, SQLite, ROS 1, and folders of them."""
