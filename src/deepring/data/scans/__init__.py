"""What scan files hold: records, point clouds, bags, and the listing of a folder of them."""
