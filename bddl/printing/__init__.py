"""From trees and texts to laid-out text."""
