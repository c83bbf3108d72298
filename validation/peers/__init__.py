"""The scoreboard: simulators by cases, each under its own law; compute, judge, present."""
