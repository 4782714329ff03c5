"""Corrections of a flow: for each measured cause, the changes that it calls for."""
