"""Public measurements that are not part of this project, read into its format."""
