"""The live page: a lidar that is opened again after it was lost, and a server that shows it to browsers.

`traffic` says what the line carried between two moments, `feed` keeps one lidar open, `frames` are the bytes that
the page reads, `door` bounds what comes in, `access` decides which requests are allowed, `server` hands frames to
viewers, and `page.html` is the page. All of it uses the public names of lidario alone.
"""
