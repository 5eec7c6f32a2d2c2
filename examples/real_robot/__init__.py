"""A dry run of what runs a real robot: its world and skills (client.py), and a robot that is none (fake_robot.py)."""
