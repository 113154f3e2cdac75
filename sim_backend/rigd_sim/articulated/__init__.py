"""Simulates an articulated robot with slip: modules, wheels, drives, hinges, camera tracker."""
