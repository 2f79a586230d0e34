from .compliant_plant import CompliantPlant as CompliantPlant
