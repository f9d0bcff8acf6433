"""Vision-language risk understanding: labels of videos, answers of models, and their scores."""
