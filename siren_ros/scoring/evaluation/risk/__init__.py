"""Vision-language risk understanding: labels of videos from the record, answers of models, and their scores."""
