"""What has to stay positive along a motion while its modes hold."""
