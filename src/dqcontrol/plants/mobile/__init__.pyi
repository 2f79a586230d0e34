from .mobile_plant import MobilePlant as MobilePlant
