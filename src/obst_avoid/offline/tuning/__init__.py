"""The tuning page: `settings.py` what can be changed, `source.py` the pictures, `robot.py` a running one, `page.py`."""
