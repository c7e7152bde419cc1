"""The live page: a lidar that is opened again after it was lost, and a server that shows it to browsers.

All of it uses the public names of lidario alone.
"""
